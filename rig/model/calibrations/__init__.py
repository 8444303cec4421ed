"""What the rig has learned of itself: records of calibrations, the store that keeps them, and their use.

How they are measured is in `rig.calibrate`.
"""
