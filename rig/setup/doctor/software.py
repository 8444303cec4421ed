"""Python, and the packages that everything needs."""

import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from rig.setup.doctor.finding import Finding
from rig.setup.install import install

_PACKAGES = ("numpy", "scipy", "h5py", "matplotlib", "numba", "ducc0", "pyserial", "pyusb")


def check() -> Iterator[Finding]:
    """Return what is installed."""
    yield Finding("Python", "ok", sys.version.split()[0])
    for package in _PACKAGES:
        try:
            yield Finding(package, "ok", version(package))
        except PackageNotFoundError:
            yield Finding(package, "missing", "not installed", install(package))
