"""What is watched while a scan runs: that the rig stays as it was when the scan began.

What a file says of power, rate, gate and bias is read back once. It is true of all positions only if nothing
changes afterwards; so everything is read back again with every line. What is seen here ends the scan or is
told. A device that lies without a trace cannot be seen: a mirror without read-back that says it has moved,
and has not.
"""

from collections.abc import Mapping
from math import ceil, isclose, sqrt
from typing import Protocol

from drivers.errors import DeviceError, LinkError, ProtocolError
from rig.errors import DoubtError, LightLostError
from rig.light.guard import ASKING_LEASE_S, LIBRARY_LEASE_S
from rig.model.config import RigConfig
from rig.model.devices import (
    Clock,
    Exposure,
    Galvo,
    GatedSpad,
    GuardedLaser,
    Rates,
    Settings,
    TimingInstrument,
)
from rig.model.quantities import show
from rig.model.state import RigState

#: How often everything is read back within a line, and within an exposure.
READ_BACK_S = 2.0

#: How often mirror and count rates are looked at during a long exposure.
LOOK_S = 0.2

#: What moves by itself, or is watched elsewhere.
DRIFTING = {
    "angle_x_rad",
    "angle_y_rad",
    "temperature_c",
    "status",
    "trajectory_index",
    "trajectory_positions",
}

#: By how much a number that is read back may differ, relative: of the rates of sync pulses and of gates, of
#: a measured bias, of everything else that was set.
SYNC_WITHIN = 0.01
BIAS_WITHIN = 0.05
SET_WITHIN = 1e-3

#: Largest part of the detections that are possible, one a pulse and one a hold-off, that a detector may make.
BEARABLE = 0.5

#: Detections a pulse above which histograms are visibly distorted, as the scan warns at its beginning.
PILE_UP = 0.05

#: From one line to the next the rate may change by this factor; the wall's own variation is far less.
LEAP = 2.5

#: An exposure, or a line, whose rate promises so many photons and that has none is no chance (2e-9).
EXPECTED_AT_LEAST = 20.0


class Rig(Protocol):
    """What is watched."""

    @property
    def clock(self) -> Clock:
        """The time that all devices share."""
        ...

    @property
    def laser(self) -> GuardedLaser:
        """The laser behind its guard."""
        ...

    @property
    def galvo(self) -> Galvo:
        """The mirror."""
        ...

    @property
    def spad(self) -> GatedSpad:
        """The detector."""
        ...

    @property
    def tcspc(self) -> TimingInstrument:
        """The timing instrument."""
        ...

    def read_back(self) -> dict[str, Settings]:
        """Return identity and settings of each device as they are now."""
        ...


class Vigil:
    """Holds the rig against what it was when a pass began.

    Parameters
    ----------
    rig
        The open devices.
    state
        How the rig is set; it decides how many counts a detector bears.
    adjusted
        Whether a person changes the light meanwhile, down to none: then a rate that leaps, or ends, is no
        reason for doubt, and pile-up is for that person to see. Too much light is one, as ever.
    """

    def __init__(self, rig: Rig, state: RigState, *, adjusted: bool = False) -> None:
        self._rig = rig
        self._adjusted = adjusted
        config = state.config
        asked_hz = config.detector.max_count_rate_hz
        each_hz = BEARABLE * _fastest_hz(config) if asked_hz is None else asked_hz
        self._bearable_hz = len(config.channels) * each_hz
        self._settings: dict[str, object] = {}
        self._sync_hz = 0.0
        self._count_hz = 0.0
        self._photons, self._live_s = 0, 0.0
        self._line_before: tuple[int, float] | None = None
        self._looked_s = self._read_s = 0.0
        self._settle_timeout_s = config.galvo.settle_timeout_s
        self._too_bright = False
        self._piled_up = False

    def begin(self, rates: Rates, settings: Mapping[str, Settings]) -> None:
        """Remember how everything is at the beginning of a pass."""
        self._settings = _flat(settings)
        self._sync_hz, self._count_hz = rates.sync_hz, rates.input_hz
        self._piled_up = rates.input_hz > PILE_UP * rates.sync_hz
        self._photons, self._live_s, self._line_before = 0, 0.0, None

    def require_bearable(self, rates: Rates) -> None:
        """Raise if the detector gets more light than it may.

        Raises
        ------
        DoubtError
            The bias has to be taken away.
        """
        if rates.input_hz > self._bearable_hz:
            raise DoubtError(
                f"the detector counts {show(rates.input_hz, 'counts/s')}, "
                f"but more than {show(self._bearable_hz, 'counts/s')} may harm it: too much light. "
                f"{self._what_is_done()} "
                "Check room light, gate and filters (detector.max_count_rate is the limit)."
            )

    def _what_is_done(self) -> str:
        if "bias" not in self._rig.spad.by_hand:
            return "Its bias is switched off."
        return (
            "Light and gate are switched off as far as the program can. "
            "IT CANNOT SWITCH OFF THE BIAS: SWITCH IT OFF BY HAND, NOW."
        )

    def measured(self, exposure: Exposure) -> None:
        """Add up what was counted since everything was read back the last time.

        Raises
        ------
        DoubtError
            If nothing was recorded although the instrument counts, or there is too much light.
        """
        self._photons += exposure.photons
        self._live_s += exposure.live_time_s
        if not exposure.photons and self._count_hz * exposure.live_time_s >= EXPECTED_AT_LEAST:
            self._require_photons(self._rates(), 0, exposure.live_time_s)
        now_s = self._rig.clock.now_s()
        if self._too_bright or now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            self._bright(self._rates())

    def look(self) -> list[str]:
        """Look at mirror and count rates during a long exposure, and now and then at everything.

        Returns
        -------
        list of str
            What was noticed and does not end the scan.

        Raises
        ------
        DoubtError
            If there is too much light, twice in a row, or something is not as it was.
        DeviceError
            If the mirror no longer holds its position.
        """
        now_s = self._rig.clock.now_s()
        if now_s - self._looked_s < LOOK_S:
            return []
        noticed = []
        self._looked_s = now_s
        self._rig.laser.beat(ASKING_LEASE_S)
        try:
            self._rig.galvo.wait_settled(self._settle_timeout_s)
        except (LinkError, ProtocolError) as first:  # one answer that is lost or garbled ends no exposure
            self._rig.galvo.wait_settled(self._settle_timeout_s)
            noticed.append(f"the mirror was asked a second time: {first}")
        if now_s - self._read_s >= READ_BACK_S:
            self._require_settings()
        self._bright(self._rates())
        return noticed

    def vouch(self) -> list[str]:
        """Read everything back, and hold it against the beginning.

        Returns
        -------
        list of str
            What was noticed and does not end the scan.

        Raises
        ------
        DoubtError
            If something is not as it was; `rig.errors.LightLostError` if it is the light.
        """
        self._require_light()
        self._rig.laser.beat(ASKING_LEASE_S)
        self._require_settings()
        rates = self._rates()
        self._bright(rates)
        self._require_sync(rates)
        self._require_photons(rates, self._photons, self._live_s)
        noticed = [*self._leap(), *self._pile_up(rates)]
        self._line_before = (self._photons, self._live_s)
        self._photons, self._live_s = 0, 0.0
        return noticed

    def _rates(self) -> Rates:
        """Read the rates, for as long as a library's call may take."""
        self._rig.laser.beat(LIBRARY_LEASE_S)
        return self._rig.tcspc.rates()

    def _require_light(self) -> None:
        laser = self._rig.laser
        try:
            emitting = laser.emitting()
        except DeviceError:  # one garbled answer is no reason to end a scan
            emitting = laser.emitting()
        laser.beat(ASKING_LEASE_S)  # tells why, where the guard knows
        if not emitting:
            raise LightLostError("the laser went dark without a command: check interlock and key.")

    def _require_settings(self) -> None:
        self._read_s = self._rig.clock.now_s()
        try:
            found = _flat(self._rig.read_back())
        except DeviceError:
            found = _flat(self._rig.read_back())
        changed = [
            f"{name} is {found.get(name)}, was {was}"
            for name, was in self._settings.items()
            if not _same(name, was, found.get(name))
        ]
        if changed:
            raise DoubtError(f"the settings of the rig changed during the scan: {'; '.join(changed)}.")

    def _require_sync(self, rates: Rates) -> None:
        if not isclose(rates.sync_hz, self._sync_hz, rel_tol=SYNC_WITHIN):
            raise DoubtError(
                f"the sync rate is {show(rates.sync_hz, 'Hz')}, and was {show(self._sync_hz, 'Hz')}: check "
                "the laser's repetition rate and the sync cable."
            )

    def _require_photons(self, rates: Rates, photons: int, live_s: float) -> None:
        if self._adjusted:
            return
        expected = min(self._count_hz, rates.input_hz or self._count_hz) * live_s
        if photons == 0 and expected >= EXPECTED_AT_LEAST:
            raise DoubtError(
                f"nothing was recorded in {show(live_s, 's')}, although the instrument counted "
                f"{show(self._count_hz, 'counts/s')}: check the detector, its cable, and that the histogram "
                "covers the gate (tcspc.offset, tcspc.bins)."
            )

    def _bright(self, rates: Rates) -> None:
        too_bright = rates.input_hz > self._bearable_hz
        if too_bright and self._too_bright:
            self.require_bearable(rates)
        self._too_bright = too_bright

    def _leap(self) -> list[str]:
        """Tell when the rate of what is recorded leaps from one reading back to the next."""
        if self._adjusted or self._line_before is None or not self._live_s:
            return []
        before, before_s = self._line_before
        now_hz, before_hz = self._photons / self._live_s, before / before_s if before_s else 0.0
        sigma_hz = sqrt(self._photons + 1) / self._live_s + (sqrt(before + 1) / before_s if before_s else 0.0)
        low_hz, high_hz = sorted((now_hz, before_hz))
        if high_hz - LEAP * low_hz < 5 * sigma_hz:
            return []
        return [
            f"the rate of recorded photons went from {show(before_hz, 'photons/s')} to "
            f"{show(now_hz, 'photons/s')}: check laser, room light and gate"
        ]

    def _pile_up(self, rates: Rates) -> list[str]:
        piled_up = rates.input_hz > PILE_UP * rates.sync_hz
        begins, self._piled_up = piled_up and not self._piled_up, piled_up
        if self._adjusted or not begins:
            return []
        percent = 100 * rates.input_hz / rates.sync_hz
        return [f"{percent:.0f} % of the pulses are counted: early photons hide late ones (pile-up)"]


def _fastest_hz(config: RigConfig) -> float:
    """Return the detections a second that are possible; a gated detector misses gates while it holds off."""
    hold_off_s = max(config.detector.hold_off_s, 1e-9)
    if not config.detector.gated:
        return 1 / hold_off_s
    pulses_hz = config.gate_hz
    return pulses_hz / (1 + ceil(hold_off_s * pulses_hz - 1e-6))  # a hold-off of one period closes one gate


def _flat(settings: Mapping[str, Settings]) -> dict[str, object]:
    return {
        f"{device} {name}": value
        for device, said in settings.items()
        for name, value in said.items()
        if name not in DRIFTING
    }


def _same(name: str, was: object, now: object) -> bool:
    if isinstance(was, bool) or not isinstance(was, int | float) or not isinstance(now, int | float):
        return was == now
    measured = {"bias_v": BIAS_WITHIN, "gate_rate_hz": SYNC_WITHIN}
    within = next((part for end, part in measured.items() if name.endswith(end)), SET_WITHIN)
    return isclose(was, now, rel_tol=within, abs_tol=1e-15)
