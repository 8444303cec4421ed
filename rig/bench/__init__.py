"""The simulated bench that a configuration describes, and what it does without devices.

The only room that imports `simulators`.
"""
