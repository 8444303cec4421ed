"""The simulated devices at the wires where drivers expect the real ones; they act on the bench alone."""
