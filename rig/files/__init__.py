"""The program's own data files: scans and volumes."""

from rig.files.description import ScanDescription
from rig.files.scan import ScanFile
from rig.files.volume import Volume, read_volume, write_volume
from rig.files.writer import ScanWriter
from rig.model.delays import PathDelays

__all__ = ["PathDelays", "ScanDescription", "ScanFile", "ScanWriter", "Volume", "read_volume", "write_volume"]
