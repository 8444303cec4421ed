"""From a scan file to a volume: recalibrated, focused, measured. It touches no device."""
