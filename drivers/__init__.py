"""Drivers: one module or package for each device, spoken to over its real wire.

Nothing here knows scans, files or pictures, and nothing here knows whether the wire ends in a device or
in a simulator.
"""
