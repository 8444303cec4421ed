"""Writing scans and volumes in layouts that other programs read."""

from rig.exporters.convert import SCAN_LAYOUTS, VOLUME_LAYOUTS, export

__all__ = ["SCAN_LAYOUTS", "VOLUME_LAYOUTS", "export"]
