"""The application: scans, files, pictures and the command line over drivers, simulators and recon."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("nlos-rig")
except PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0+unknown"
