"""What a rig is: its configuration, calibrations, the state they resolve to, plans. Values only: it opens
neither devices nor data files."""
