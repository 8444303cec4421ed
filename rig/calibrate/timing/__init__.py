"""First bounces in time: when the pulse is on the wall, and how the whole system answers to it."""
