"""Shutters that a single line moves: TTL, or a level of a serial port."""
