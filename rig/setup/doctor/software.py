"""Python, and the packages that everything needs."""

import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from rig.install import install
from rig.setup.doctor.finding import Finding

_PACKAGES = ("numpy", "scipy", "h5py", "matplotlib", "numba", "ducc0", "pyserial", "pyusb")


def check() -> Iterator[Finding]:
    """Return what is installed."""
    yield Finding("Python", "ok", sys.version.split()[0])
    for package in _PACKAGES:
        try:
            yield Finding(package, "ok", version(package))
        except PackageNotFoundError:
            yield Finding(package, "missing", "not installed", install(package))
