"""The application: scans, files, pictures and the command line over drivers, simulators and recon.

From Python (docs/python.md), imported when first used:

- `open`, `open_scan` and `open_volume`: what a file holds, as a `Scan` or an `Image`;
- `plan`, `scan` and `resume`: measure, with a `Plan` and a `Progress` that is reported;
- `import_scan` and `export`: files of other programs.

Failures that a person can mend are `RigError`, `drivers.errors.DeviceError` and `recon.ReconError`.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rig.api.images import Image, open_volume
    from rig.api.scanning import Plan, Progress, plan, resume, scan
    from rig.api.scans import Scan, open_scan
    from rig.api.scans import open_file as open
    from rig.errors import RigError
    from rig.exporters.convert import export
    from rig.importers import import_scan

__all__ = [
    "Image",
    "Plan",
    "Progress",
    "RigError",
    "Scan",
    "export",
    "import_scan",
    "open",
    "open_scan",
    "open_volume",
    "plan",
    "resume",
    "scan",
]

try:
    __version__ = version("nlos-rig")
except PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0+unknown"

#: Where each name is.
_PLACES = {
    "Image": "rig.api.images:Image",
    "Plan": "rig.api.scanning:Plan",
    "Progress": "rig.api.scanning:Progress",
    "RigError": "rig.errors:RigError",
    "Scan": "rig.api.scans:Scan",
    "export": "rig.exporters.convert:export",
    "import_scan": "rig.importers:import_scan",
    "open": "rig.api.scans:open_file",
    "open_scan": "rig.api.scans:open_scan",
    "open_volume": "rig.api.images:open_volume",
    "plan": "rig.api.scanning:plan",
    "resume": "rig.api.scanning:resume",
    "scan": "rig.api.scanning:scan",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for; heavy libraries come with it, not before."""
    if name not in _PLACES:
        raise AttributeError(f"module 'rig' has no attribute '{name}'")
    module, found = _PLACES[name].split(":")
    return getattr(import_module(module), found)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
