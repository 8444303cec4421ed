"""How calibrations are measured through the devices, fitted, and shown."""
