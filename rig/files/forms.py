"""Which form a scan file has, or is to have."""

import h5py

from rig.files.description import ScanDescription
from rig.files.form import Form
from rig.files.form_counts import CountForm
from rig.files.form_photons import PhotonForm


def of_file(file: h5py.File) -> type[Form]:
    """Return the form in which a scan file holds its photons."""
    return PhotonForm if "photons" in file["transients"] else CountForm


def asked(description: ScanDescription) -> type[Form]:
    """Return the form in which a scan file is to hold its photons."""
    return PhotonForm if description.tagged else CountForm


def written_here(file: h5py.File) -> bool:
    """Return whether a scan file is stored as `ScanWriter` stores it, so that it can add to it."""
    transients = file["transients"]
    common = {"done", "live_time_s"} <= set(transients) and "start" in file
    return common and of_file(file).written_here(transients)
