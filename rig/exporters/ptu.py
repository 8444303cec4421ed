"""PicoQuant ``.ptu``: a scan as the time-tagged records of a HydraHarp, with a marker at each point.

A scan holds in which bin a photon came, not after which pulse: photons of a step are spread evenly over its
pulses, in an order drawn with a fixed seed. Markers: 1 at each point, 2 at each line, 3 at the frame, in one
record where they coincide. Places and delays, for which the layout has no form, are in tags of this program's
own (`rig.files.picoquant`), so that `rig import` needs no plan; other programs pass over them.
"""

import struct
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files import ScanFile
from rig.files.picoquant import (
    BINS,
    DELAY,
    DETECTOR,
    FADE,
    FIRST_BIN,
    FRAME_MARKER,
    INPUTS,
    LASER,
    LINE_MARKER,
    MAGIC_RECORDS,
    POINT_MARKER,
    head_bytes,
    place_of,
)

if TYPE_CHECKING:
    from drivers.hydraharp.records import Batch

NAME = "PicoQuant records, T3"
ENDINGS = (".ptu",)

#: The type of T3 records in version 2.
_RECORD_TYPE = 0x01010304
_COUNT = "TTResult_NumberOfRecords"
#: How long a step is where the scan does not say [s].
_STEP_S = 1e-3
#: The laser's rate where the scan does not say, if its bins fit between two pulses [Hz].
_RATE_HZ = 10e6
#: Spots of a line differ less than this across it [m].
_SAME_M = 1e-6


def write(path: Path, scan: ScanFile, rectify: bool = False) -> None:
    """Write the file, step by step; frames are added up, as they are for imaging.

    Raises
    ------
    UsageError
        If the scan holds no photons but expectations, has more bins than a record can tell, or is to be
        rectified.
    """
    from drivers.hydraharp.records import T3, Encoder  # compiled kernels: not for all files

    _check(scan, rectify)
    steps, histograms = scan.imaged
    laser_m = scan.laser_m[steps]
    inputs = [channel.input for channel in scan.channels]
    pulses = _pulses(scan, steps)
    head = head_bytes(MAGIC_RECORDS, _tags(scan, steps, inputs, float(pulses.sum() / _rate_hz(scan))))
    encoder, records = Encoder(T3), 0
    with path.open("xb") as file:
        file.write(head)
        masks = _masks(laser_m)
        for batch in _batches(histograms, len(inputs), pulses, masks, np.array(inputs, np.int8)):
            encoded = encoder.encode(batch)
            encoded.astype("<u4", copy=False).tofile(file)
            records += len(encoded)
        _put(file, place_of(head, _COUNT), struct.pack("<q", records))


def _check(scan: ScanFile, rectify: bool) -> None:
    from drivers.hydraharp.records import MAX_CHANNEL, MAX_DTIME

    if rectify:
        raise UsageError(
            "--rectified is not for .ptu, whose times are those of an instrument: the delays are kept beside "
            "them. Leave it out"
        )
    if scan.expectation:
        raise UsageError(f"{scan.path} holds expectations, not photons, of which records could be made")
    if scan.bins > MAX_DTIME + 1:
        raise UsageError(f"{scan.path} has {scan.bins:,} bins; a record can tell {MAX_DTIME + 1:,}")
    inputs = [channel.input for channel in scan.channels]
    if len(set(inputs)) < len(inputs) or not all(0 <= one <= MAX_CHANNEL for one in inputs):
        raise UsageError(
            f"{scan.path}: its channels have the inputs {inputs}, which a record cannot tell apart"
        )


def _rate_hz(scan: ScanFile) -> float:
    """Return the rate of the laser's pulses."""
    state = scan.state
    if state is not None:
        return float(state.config.laser.repetition_hz)
    return min(_RATE_HZ, 1 / (scan.bins * scan.bin_width_s))


def _pulses(scan: ScanFile, steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (n,) pulses of each step."""
    live_s = scan.live_time_s[steps].astype(float)
    return np.maximum(
        1, np.rint(np.where(np.isfinite(live_s) & (live_s > 0), live_s, _STEP_S) * _rate_hz(scan))
    ).astype(np.int64)


def _tags(
    scan: ScanFile, steps: NDArray[np.int64], inputs: list[int], duration_s: float
) -> Iterator[tuple[str, Any]]:
    """Yield the tags of the head: those that the layout demands, and where it has no form our own."""
    rate_hz = _rate_hz(scan)
    yield "File_GUID", f"{{{str(uuid.uuid4()).upper()}}}"
    yield "CreatorSW_Name", "nlos-rig"
    yield "CreatorSW_Version", "1"
    yield "File_Comment", f"from {scan.path.name}; marker 1: point, 2: line, 3: frame"
    yield "Measurement_Mode", 3
    yield "Measurement_SubMode", 0
    yield "TTResult_StopReason", 0
    yield "TTResultFormat_TTTRRecType", _RECORD_TYPE
    yield "TTResultFormat_BitsPerRecord", 32
    yield "MeasDesc_BinningFactor", max(1, round(scan.bin_width_s / 1e-12))
    yield "MeasDesc_Offset", 0
    yield "MeasDesc_AcquisitionTime", max(1, round(duration_s * 1e3))
    yield "HW_Type", "HydraHarp 400"
    yield "HW_BaseResolution", 1e-12
    yield "HW_InpChannels", max(inputs) + 1
    yield "HWSync_Divider", 1
    yield "MeasDesc_Resolution", scan.bin_width_s
    yield "MeasDesc_GlobalResolution", 1 / rate_hz
    yield "TTResult_SyncRate", round(rate_hz)
    yield LASER, scan.laser_m[steps].ravel()
    detector_m = scan.detector_m if len(scan.detector_m) == 1 else scan.detector_m[steps]
    yield DETECTOR, detector_m.ravel()
    yield INPUTS, np.array(inputs, float)
    yield FIRST_BIN, float(scan.first_bin_s)
    yield BINS, scan.bins
    if scan.time_origin == "laser":
        yield DELAY, scan.rectified_by_s()[steps].ravel()
    if scan.fade_from_s is not None:
        yield FADE, float(scan.fade_from_s)
    yield _COUNT, 0


def _masks(laser_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return (n,) which markers each point has; a line goes on as long as one coordinate stays."""
    masks = np.full(len(laser_m), 1 << POINT_MARKER - 1, np.uint8)
    masks[0] |= 1 << LINE_MARKER - 1 | 1 << FRAME_MARKER - 1
    moved = np.abs(np.diff(laser_m, axis=0)) > _SAME_M
    across = 0 if len(moved) and not moved[0, 0] else 1  # the coordinate that stays in the first line
    masks[1:][moved[:, across]] |= 1 << LINE_MARKER - 1
    return masks


def _batches(
    histograms: Any,
    channels: int,
    pulses: NDArray[np.int64],
    masks: NDArray[np.uint8],
    inputs: NDArray[np.int8],
) -> Iterator["Batch"]:
    """Yield each point's marker and photons."""
    rng = np.random.default_rng(0)
    point, start = 0, 0
    rows: list[NDArray] = []
    for _, block in histograms.blocks():
        for row in block:
            rows.append(row)
            if len(rows) == channels:
                batch, start = _point(
                    np.array(rows), (start, int(pulses[point]), int(masks[point])), inputs, rng
                )
                yield batch
                point, rows = point + 1, []


def _point(
    counts: NDArray, place: tuple[int, int, int], inputs: NDArray[np.int8], rng: np.random.Generator
) -> tuple["Batch", int]:
    """Return a point's marker and photons, and the first pulse of the next."""
    from drivers.hydraharp.records import Batch

    start, pulses, mask = place
    channel, dtime = np.nonzero(counts)
    times = counts[channel, dtime]
    order = rng.permutation(int(times.sum()))
    channel, dtime = np.repeat(channel, times)[order], np.repeat(dtime, times)[order]
    photons = len(order)
    pulses = max(pulses, photons + 1)
    tag = start + ((np.arange(photons) + 0.5) * (pulses / max(1, photons))).astype(np.int64)
    batch = Batch(
        tag,
        dtime.astype(np.uint16),
        inputs[channel],
        np.array([start], np.int64),
        np.array([mask], np.uint8),
        np.zeros(1, np.int64),
    )
    return batch, start + pulses


def _put(file: BinaryIO, place: int, data: bytes) -> None:
    file.seek(place)
    file.write(data)
