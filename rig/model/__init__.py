"""What a rig is: configuration, calibrations, the state they resolve to, plans.

Values only: nothing here opens a device or a data file.
"""
