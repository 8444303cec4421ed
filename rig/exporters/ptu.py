"""PicoQuant ``.ptu``: a scan as the time-tagged records of a HydraHarp, with a marker at each point.

A scan holds in which bin a photon came, not after which pulse: photons of a step are spread evenly over its
pulses, in an order drawn with a fixed seed. Markers: 1 at each point, 2 at each line, 3 at the frame, in one
record where they coincide. Places and delays, for which the layout has no form, are in tags of this program's
own (`rig.files.picoquant`), so that `rig import` needs no plan; other programs pass over them.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files import ScanFile
from rig.files.picoquant import FRAME_MARKER, LINE_MARKER, MAGIC_RECORDS, POINT_MARKER, head_bytes
from rig.files.records import RATE_HZ, RecordsHead, begins_line, put_count

if TYPE_CHECKING:
    from drivers.harp.records import Batch

NAME = "PicoQuant records, T3"
ENDINGS = (".ptu",)

#: How long a step is where the scan does not say [s].
_STEP_S = 1e-3


def write(path: Path, scan: ScanFile, rectify: bool = False) -> None:
    """Write the file, step by step; frames are added up, as they are for imaging.

    Raises
    ------
    UsageError
        If the scan holds no photons but expectations, has more bins than a record can tell, or is to be
        rectified.
    """
    from drivers.harp.records import T3, Encoder  # compiled kernels: not for all files

    _check(scan, rectify)
    steps, histograms = scan.imaged
    laser_m = scan.laser_m[steps]
    inputs = [channel.input for channel in scan.channels]
    pulses = _pulses(scan, steps)
    head = head_bytes(MAGIC_RECORDS, _head(scan, steps, float(pulses.sum() / _rate_hz(scan))).tags())
    encoder, records = Encoder(T3), 0
    with path.open("xb") as file:
        file.write(head)
        masks = _masks(laser_m)
        for batch in _batches(histograms, len(inputs), pulses, masks, np.array(inputs, np.int8)):
            encoded = encoder.encode(batch)
            file.write(encoded.astype("<u4", copy=False).data)
            records += len(encoded)
        put_count(file, head, records)


def _check(scan: ScanFile, rectify: bool) -> None:
    from drivers.harp.records import MAX_CHANNEL, MAX_DTIME

    if rectify:
        raise UsageError(
            "--rectified is not for .ptu, whose times are those of an instrument: the delays are kept beside "
            "them. Leave it out"
        )
    if scan.expectation:
        raise UsageError(
            f"{scan.path} holds expectation values, not photons, so records cannot be made of it"
        )
    if scan.bins > MAX_DTIME + 1:
        raise UsageError(f"{scan.path} has {scan.bins:,} bins; a record can hold {MAX_DTIME + 1:,}")
    inputs = [channel.input for channel in scan.channels]
    if len(set(inputs)) < len(inputs) or not all(0 <= one <= MAX_CHANNEL for one in inputs):
        raise UsageError(
            f"{scan.path}: its channels have the inputs {inputs}, which a record cannot distinguish"
        )


def _rate_hz(scan: ScanFile) -> float:
    """Return the rate of the laser's pulses."""
    state = scan.state
    if state is not None:
        return float(state.config.laser.repetition_hz)
    return min(RATE_HZ, 1 / (scan.bins * scan.bin_width_s))


def _pulses(scan: ScanFile, steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (n,) pulses of each step."""
    live_s = scan.live_time_s[steps].astype(float)
    return np.maximum(
        1, np.rint(np.where(np.isfinite(live_s) & (live_s > 0), live_s, _STEP_S) * _rate_hz(scan))
    ).astype(np.int64)


def _head(scan: ScanFile, steps: NDArray[np.int64], duration_s: float) -> RecordsHead:
    return RecordsHead(
        comment=f"from {scan.path.name}; marker 1: point, 2: line, 3: frame",
        laser_m=scan.laser_m[steps],
        detector_m=scan.detector_m if len(scan.detector_m) == 1 else scan.detector_m[steps],
        inputs=tuple(channel.input for channel in scan.channels),
        bins=scan.bins,
        bin_width_s=scan.bin_width_s,
        first_bin_s=scan.first_bin_s,
        rate_hz=_rate_hz(scan),
        duration_s=duration_s,
        delay_s=scan.rectified_by_s()[steps] if scan.time_origin == "laser" else None,
        fade_from_s=scan.fade_from_s,
    )


def _masks(laser_m: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return (n,) which markers each point has."""
    masks = np.full(len(laser_m), 1 << POINT_MARKER - 1, np.uint8)
    masks[begins_line(laser_m)] |= 1 << LINE_MARKER - 1
    masks[0] |= 1 << FRAME_MARKER - 1
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
    from drivers.harp.records import Batch

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
