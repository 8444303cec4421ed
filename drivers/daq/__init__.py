"""A data acquisition board: the point clock's pulses, and the voltages of an analogue galvo."""
