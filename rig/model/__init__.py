"""What a rig is: configuration, calibrations, the state they resolve to, plans.

Values only: nothing here opens a device or a data file.
"""

#: What --frames says of a scan without a last frame; here, where the command line's help reads it at no cost.
UNTIL_STOPPED = "until-stopped"
