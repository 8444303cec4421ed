"""Reading published transients of other layouts into a scan file."""

from rig.importers.convert import LAYOUTS, ImportReport, import_scan

__all__ = ["LAYOUTS", "ImportReport", "import_scan"]
