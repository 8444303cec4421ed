"""From a scan file to a volume: recalibrated, focused, measured. No device is touched."""
