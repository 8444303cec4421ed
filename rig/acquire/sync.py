"""What is said of sync pulses that do not come, or not as often as the laser gives them."""

from math import isclose

from rig.errors import RefusedError
from rig.model.devices import Rates, Settings
from rig.model.quantities import show

#: The sync rate is the laser's within this part; the instrument counts for 100 ms, by a clock of its own.
AS_SET = 0.01


def none_came(settings: Settings) -> str:
    """Return why a scan does not begin when the timing instrument sees no sync pulses.

    Parameters
    ----------
    settings
        The timing instrument's, as read back.
    """
    level_v = settings.get("sync_level_v")
    level = ""
    if level_v is not None:
        level = f" and tcspc.sync_level ({show(float(level_v), 'V')}: lower pulses are not seen)"
    return (
        "the timing instrument sees no sync pulses although the laser reports that it emits. "
        f"Check the sync cable{level}, then scan again"
    )


def require_gate(detector: Settings, expected_hz: float, repetition_hz: float) -> None:
    """Refuse a gate that does not follow the laser, where the detector tells how often it opens.

    Parameters
    ----------
    detector
        Its settings, as read back while the laser emits.
    expected_hz
        How often it is to open a second.
    repetition_hz
        Pulses a second of the laser.

    Raises
    ------
    RefusedError
        If the gate opens more or less often.
    """
    gate_hz = detector.get("gate_rate_hz")
    if gate_hz is None or not detector.get("gated"):
        return
    if isclose(float(gate_hz), expected_hz, rel_tol=AS_SET):
        return
    divided = "" if expected_hz == repetition_hz else f", {show(expected_hz, 'Hz')} after delayer.divider"
    raise RefusedError(
        f"the detector's gate opens at {show(float(gate_hz), 'Hz')}, "
        f"but the laser is set to {show(repetition_hz, 'Hz')}{divided}: "
        "check the cable from the laser's sync output to the gate, "
        "the thresholds of detector and delayer, and the delayer's output"
    )


def doubts(rates: Rates, repetition_hz: float, settings: Settings) -> tuple[str, ...]:
    """Return a warning where the sync rate is not the laser's, of an instrument with a discriminator."""
    if "sync_level_v" not in settings or isclose(rates.sync_hz, repetition_hz, rel_tol=AS_SET):
        return ()
    return (
        f"The sync rate is {show(rates.sync_hz, 'Hz')}, but the laser is set to {show(repetition_hz, 'Hz')}: "
        "if the level is too low, noise is counted; if it is too high, pulses are lost "
        f"(tcspc.sync_level, {show(float(settings['sync_level_v']), 'V')}).",
    )
