"""Writing what a scan file says before its first photon."""

from datetime import UTC, datetime

import h5py
import numpy as np

import rig
from rig.files.description import ScanDescription
from rig.files.layout import SCAN, Layout

#: Positions in one chunk of the file: 1 MB of 15,000 bins.
CHUNK_POSITIONS = 16
#: zlib's quickest level. Measured on sparse counts: level 4 takes nearly twice as long.
COMPRESSION = 1


def utc_now() -> str:
    """Return the present time, UTC, ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def write_start(file: h5py.File, description: ScanDescription) -> None:
    """Write all groups and datasets of a new scan file, the photons still to come."""
    positions, bins = description.positions, description.bins
    write_root(file, "rig-scan")
    start = file.create_group("start")
    for name in ("plan", "configuration", "simulated", "command"):
        start.attrs[name] = getattr(description, name)
    if description.imported:
        start.attrs["imported"] = description.imported
    devices = file.create_group("devices")
    for name, settings in description.devices.items():
        devices.create_group(name).attrs.update(settings)
    geometry = file.create_group("geometry")
    geometry["laser_m"] = np.asarray(description.laser_m, "<f8")
    geometry["detector_m"] = np.asarray(description.detector_m, "<f8")
    if description.legs is not None:
        geometry.attrs["laser_head_m"] = np.asarray(description.legs.laser_head_m, "<f8")
        geometry.attrs["detector_head_m"] = np.asarray(description.legs.detector_head_m, "<f8")
        geometry.attrs["electronics_delay_s"] = float(description.legs.electronics_delay_s)
    if description.delay_s is not None:
        geometry["delay_s"] = np.asarray(description.delay_s, "<f8")
    if description.mirror_rad is not None:
        geometry["mirror_rad"] = np.asarray(description.mirror_rad, "<f8")
    if description.calibrations:
        calibrations = file.create_group("calibration")
        for kind, document in description.calibrations.items():
            calibrations[kind] = document
    transients = file.create_group("transients")
    transients.attrs["time_origin"] = description.time_origin
    transients.attrs["bins"] = bins
    for name in (
        "bin_width_s",
        "first_bin_s",
        "fade_from_s",
        "gate_start_s",
        "gate_stop_s",
        "instrument_response_s",
    ):
        value = getattr(description, name)
        if value is not None:
            transients.attrs[name] = float(value)
    counts = transients.create_dataset(
        "counts",
        (positions, bins),
        description.dtype,
        chunks=(min(CHUNK_POSITIONS, positions), bins),
        compression="gzip",
        compression_opts=COMPRESSION,
        shuffle=True,
    )
    counts.attrs["kind"] = "expectation" if counts.dtype.kind == "f" else "photons"
    transients.create_dataset("done", data=np.zeros(positions, bool))
    transients.create_dataset("live_time_s", data=np.full(positions, np.nan, "<f4"))
    describe(file, SCAN)


def write_root(file: h5py.File, name: str) -> None:
    """Write the root attributes that all our files share."""
    file.attrs["format"] = name
    file.attrs["version"] = 1
    file.attrs["software"] = f"nlos-rig {rig.__version__}"
    file.attrs["created"] = utc_now()


def describe(file: h5py.File, layout: Layout) -> None:
    """Write the descriptions of a layout beside the groups and datasets that the file has."""
    for path, entry in layout.items():
        if "@" not in path and path in file:
            file[path].attrs["description"] = entry.what
