"""What is installed and connected, and what to do about what is missing; a file for each kind of check.

It only looks: nothing moves, nothing emits, and no byte is sent to a device.
"""

from rig.setup.doctor.examination import Examination, examine
from rig.setup.doctor.finding import Finding

__all__ = ["Examination", "Finding", "examine"]
