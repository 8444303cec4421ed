"""The rig as it is: its configuration, corrected by what was calibrated; resolved once for a command."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rig.model.calibrations.chosen import Calibrations, choose
from rig.model.calibrations.store import CalibrationStore
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.pointing import Pointing
from rig.model.quantities import show

#: A calibrated delay that differs by more from the configuration's is told.
WORTH_TELLING_S = 50e-12


@dataclass(frozen=True)
class Gate:
    """When the detector is sensitive.

    Attributes
    ----------
    delay_s, width_s
        Opening edge after the sync pulse, and how long it stays open.
    """

    delay_s: float
    width_s: float


@dataclass(frozen=True)
class Channel:
    """One pixel of the detector, as it is.

    Attributes
    ----------
    name, input
        Its name, and the input of the timing instrument that gets its pulses.
    spot_m
        The spot on the wall that it looks at.
    delay_s
        By how much its pulses come later than the path delays say.
    response_s
        Full width at half maximum of its response to a pulse; None where it is not known.
    dark_hz
        Its counts a second in the dark; None where they were never measured.
    """

    name: str
    input: int
    spot_m: tuple[float, float, float]
    delay_s: float
    response_s: float | None
    dark_hz: float | None


@dataclass(frozen=True)
class RigState:
    """What the configuration says and the calibrations know better. All that follows from both is asked here.

    Attributes
    ----------
    config
        The configuration.
    calibrations
        What was calibrated; none leaves the rig as configured.
    """

    config: RigConfig
    calibrations: Calibrations = field(default_factory=Calibrations)

    @classmethod
    def resolve(cls, config: RigConfig) -> "RigState":
        """Return the state of a rig whose devices are not known yet: all calibrations are taken as theirs.

        Raises
        ------
        DataFileError
            If a stored calibration is damaged.
        """
        return cls(config).of_devices(None)

    def of_devices(self, identities: Mapping[str, str] | None) -> "RigState":
        """Return the state with the newest calibrations that belong to these devices.

        The calibrations that are known fit as a rule, and then the store is not read again.

        Raises
        ------
        DataFileError
            If a stored calibration is damaged.
        """
        if not self.config.calibration.use:
            return RigState(self.config)
        known = self.calibrations.records.values()
        if identities and known and not any(one.strangers(dict(identities)) for one in known):
            return self
        store = CalibrationStore(self.config.calibration.folder)
        chosen = choose(store, self.config.name, self.config.rehearsed, identities)
        return RigState(self.config, chosen)

    @property
    def nominal(self) -> "RigState":
        """The rig as configured, without what was calibrated."""
        return RigState(self.config)

    @cached_property
    def pointing(self) -> Pointing:
        """The model of the mirror; as configured its resting beam is square to the wall, and it obeys."""
        if self.calibrations.galvo:
            return self.calibrations.galvo.pointing()
        galvo = self.config.galvo
        angle_rad, direction_rad = galvo.incidence_rad, galvo.incidence_direction_rad
        return Pointing(
            galvo.position_m,
            incidence_rad=(angle_rad * math.cos(direction_rad), angle_rad * math.sin(direction_rad)),
            mirrors=galvo.mirrors,
            separation_m=galvo.separation_m,
        )

    @property
    def mirror_lag_s(self) -> float:
        """By how much the mirror trails its command while it moves."""
        lag = self.calibrations.lag
        return lag.lag_s if lag else self.config.galvo.lag_s

    @cached_property
    def delays(self) -> PathDelays:
        """What to subtract for rectified time; a channel's own delay comes on top."""
        if self.calibrations.time_zero:
            return self.calibrations.time_zero.legs
        galvo = self.calibrations.galvo
        return PathDelays(
            np.array(galvo.mirror_m if galvo else self.config.galvo.position_m),
            np.array(self.config.detector.position_m),
            self.config.timing.electronics_delay_s,
        )

    @property
    def gate(self) -> Gate | None:
        """When the detector is sensitive; None where it runs freely."""
        detector, found = self.config.detector, self.calibrations.gate
        if not detector.gated:
            return None
        if found:
            return Gate(found.gate_delay_s, found.gate_width_s)
        return Gate(detector.gate_delay_s, detector.gate_width_s)

    @property
    def response_s(self) -> float:
        """Full width at half maximum of the response to a pulse."""
        response = self.calibrations.response
        return response.fwhm_s if response else self.config.timing.instrument_response_s

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The detector's pixels, in the order in which a scan file holds them."""
        dark = self.calibrations.dark
        return tuple(
            Channel(
                name=one.name,
                input=one.input,
                spot_m=one.spot_m,
                delay_s=one.delay_s,
                response_s=self.response_s,
                dark_hz=dark.dark_hz if dark else None,
            )
            for one in self.config.channels
        )

    @property
    def sync_period_s(self) -> float:
        """Time between sync pulses, in which all times lie; a sync divider changes nothing in that."""
        return 1 / self.config.laser.repetition_hz

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against the calibrations, and where they overrule the configuration, as sentences."""
        found, wanted_s = self.calibrations.gate, self.config.detector.gate_delay_s
        if found is None or math.isclose(found.gate_delay_s, wanted_s, abs_tol=WORTH_TELLING_S):
            return self.calibrations.warnings
        return (
            *self.calibrations.warnings,
            f"the gate opens at {show(found.gate_delay_s, 's', 4)} as calibrated, "
            f"not at {show(wanted_s, 's', 4)} as configured",
        )
