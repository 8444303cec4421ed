"""The simulated devices, each standing at the wire where a driver expects the real one."""
