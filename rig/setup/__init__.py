"""From a crate of devices to a rig that scans: what is connected, a configuration for it, what is missing."""
