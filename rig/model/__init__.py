"""What a rig is: configuration, calibrations, the plan of a scan. Values only: no device, no data file."""
