"""The program's own data files: scans and volumes."""

from rig.files.description import Legs, ScanDescription
from rig.files.scan import ScanFile
from rig.files.writer import ScanWriter

__all__ = ["Legs", "ScanDescription", "ScanFile", "ScanWriter"]
