"""Writing what a scan file says before its first photon."""

import io
import json
from collections.abc import Mapping
from datetime import UTC, datetime

import h5py
import numpy as np

import rig
from rig.errors import UsageError
from rig.files import forms
from rig.files.content import create_events
from rig.files.description import ScanDescription, Settings
from rig.files.inspection import TEXT_BYTES
from rig.files.layout import SCAN, SCAN_VERSION, Layout
from rig.model.config import RigConfig
from rig.model.plan import ScanPlan


def utc_now() -> str:
    """Return the present time, UTC, ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def start_of(description: ScanDescription) -> bytes:
    """Return a new scan file, the photons still to come, byte by byte."""
    with io.BytesIO() as memory:
        with h5py.File(memory, "w") as file:
            _write_start(file, description)
        return memory.getvalue()


def _write_start(file: h5py.File, description: ScanDescription) -> None:
    """Write all groups and datasets of a new scan file."""
    steps, channels = description.steps, description.channel_count
    write_root(file, "rig-scan", SCAN_VERSION)
    state = description.state
    write_origin(
        file, state.config if state else None, description.devices, description.simulated, description.command
    )
    if description.plan is not None:
        file["start"].attrs["plan"] = _readable(description.plan)
    if state is not None:
        file["start"].attrs["doubts"] = json.dumps(state.doubts)
    if description.imported:
        file["start"].attrs["imported"] = json.dumps(description.imported)
    geometry = file.create_group("geometry")
    may = {"maxshape": (None, None)} if description.plan is not None and description.plan.endless else {}
    geometry.create_dataset("laser_m", data=np.asarray(description.laser_m, "<f8"), **may)
    geometry["detector_m"] = np.asarray(description.detector_m, "<f8").reshape(-1, channels, 3)
    if description.delays is not None:
        geometry.attrs["laser_head_m"] = np.asarray(description.delays.laser_head_m, "<f8")
        geometry.attrs["detector_head_m"] = np.asarray(description.delays.detector_head_m, "<f8")
        geometry.attrs["electronics_delay_s"] = float(description.delays.electronics_delay_s)
    if description.delay_s is not None:
        delay_s = np.asarray(description.delay_s, "<f8").reshape(steps, -1)
        geometry["delay_s"] = np.broadcast_to(delay_s, (steps, channels))
    if description.mirror_rad is not None:
        geometry.create_dataset("mirror_rad", data=np.asarray(description.mirror_rad, "<f8"), **may)
    _write_channels(file, description)
    documents = state.calibrations.documents() if state else {}
    if documents:
        calibrations = file.create_group("calibration")
        for kind, document in documents.items():
            calibrations[kind] = document
    for name, array in (state.calibrations.arrays() if state else {}).items():
        file.require_group("calibration_data")[name] = np.asarray(array, "<f8")
    transients = file.create_group("transients")
    transients.attrs["time_origin"] = description.time_origin
    transients.attrs["bins"] = description.bins
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
    forms.asked(description).create(transients, description)
    create_events(file)
    describe(file, SCAN)


def _readable(plan: ScanPlan) -> str:
    """Return a plan as text.

    Raises
    ------
    UsageError
        If it is longer than any that is read.
    """
    text = plan.model_dump_json()
    if len(text) > TEXT_BYTES:
        raise UsageError(
            f"the plan lists {len(plan)} positions in {len(text) / 1e6:.0f} MB of text, but at most "
            f"{TEXT_BYTES / 1e6:.0f} MB are read; divide it, or give a grid"
        )
    return text


def _write_channels(file: h5py.File, description: ScanDescription) -> None:
    """Write what is known of the channels; a channel of which nothing is known has a number for a name."""
    group = file.create_group("channels")
    count, known = description.channel_count, description.channels
    names = [one.name for one in known] or [str(number) for number in range(count)]
    group["name"] = np.array(names, dtype=h5py.string_dtype())
    group["input"] = np.array([one.input for one in known] or range(count), "<i4")
    group["delay_s"] = np.array([one.delay_s for one in known] or np.zeros(count), "<f8")
    if known:
        group["response_s"] = np.array(
            [np.nan if one.response_s is None else one.response_s for one in known], "<f8"
        )
        group["dark_hz"] = np.array([np.nan if one.dark_hz is None else one.dark_hz for one in known], "<f8")


def write_root(file: h5py.File, name: str, version: int) -> None:
    """Write the root attributes that all our files share."""
    file.attrs["format"] = name
    file.attrs["version"] = version
    file.attrs["software"] = f"nlos-rig {rig.__version__}"
    file.attrs["created"] = utc_now()


def write_origin(
    file: h5py.File,
    config: RigConfig | None,
    devices: Mapping[str, Settings],
    simulated: bool,
    command: str,
) -> None:
    """Write with what a file is measured."""
    start = file.create_group("start")
    if config is not None:
        start.attrs["configuration"] = config.for_record()
        if said := config.notes.said():
            file.create_group("notes").attrs.update(said)
    start.attrs["simulated"] = simulated
    start.attrs["command"] = storable(command)
    group = file.create_group("devices")
    for name, settings in devices.items():
        group.create_group(name).attrs.update(settings)


def storable(text: str) -> str:
    """Return text that HDF5 can hold: what is not UTF-8, such as in the name of a file, as escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def describe(file: h5py.File, layout: Layout) -> None:
    """Write the descriptions of a layout beside the groups and datasets that the file has."""
    for path, entry in layout.items():
        if "@" not in path and path in file:
            file[path].attrs["description"] = entry.what
