"""When the first bounce arrives at each position of a scan."""

from math import floor

import numpy as np

from rig.calibrate import Floats, peaks, require
from rig.calibrate.raw import Raw
from rig.errors import CalibrationError

#: Detections for each pulse above which a peak through the wide open gate is refused.
MAX_GATED_PER_PULSE = 0.2


def first_bounces(raw: Raw, *, gated: bool = False) -> peaks.Peaks:
    """Find and fit the first bounce at each measured position.

    Raises CalibrationError if more than a few positions have no good peak, or the detector was gated though
    it should not be.
    """
    require(raw.done.any(), f"{raw.label} holds no measured position: measure again")
    if not gated:
        raw.refuse_gated()
    pulses = raw.live_s[raw.done] * raw.config.laser.repetition_hz
    counts = raw.counts[raw.done]
    return peaks.find(
        counts,
        pulses,
        _live(raw, counts, pulses),
        raw.edges_s,
        name=raw.label,
        max_per_pulse=MAX_GATED_PER_PULSE if gated else peaks.MAX_PER_PULSE,
    )


def mirror_rad(raw: Raw) -> Floats:
    """Return (P, 2) commanded angles of the measured positions.

    Raises CalibrationError if the file does not say.
    """
    if raw.mirror_rad is None:
        raise CalibrationError(
            f"{raw.label} does not say where the mirror pointed (/geometry/mirror_rad is missing): measure "
            "with rig calibrate, or scan again with this version"
        )
    return raw.mirror_rad[raw.done]


def _live(raw: Raw, counts: Floats, pulses: Floats) -> Floats:
    """(P, bins) for what part of the pulses the detector is ready at that time after them.

    A free-running detector with a dead time that is not extended is off at a time exactly if it made one
    detection (it cannot make two) in the hold-off before; so the histogram itself, folded by the period,
    tells how often it was (Isbaner et al., Opt. Express 24, 9429, 2016). A hold-off of one period costs all
    times alike.
    """
    period = round(1 / (raw.config.laser.repetition_hz * raw.bin_width_s))
    hold = raw.config.detector.hold_off_s / raw.bin_width_s
    whole, rest = floor(hold / period + 1e-9), round(hold % period) % period
    per_pulse = np.zeros((len(counts), max(period, raw.bins)))
    per_pulse[:, : raw.bins] = counts / pulses[:, None]
    before = np.cumsum(np.concatenate([per_pulse[:, len(per_pulse[0]) - rest :], per_pulse], axis=1), axis=1)
    before = np.insert(before, 0, 0.0, axis=1)
    bins = np.arange(raw.bins)
    off = before[:, bins + rest] - before[:, bins] + whole * per_pulse.sum(axis=1, keepdims=True)
    return np.clip(1 - off, 1e-3, 1)
