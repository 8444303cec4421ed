"""Which calibrations a scan uses, and what they change."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from rig.errors import DataFileError
from rig.model.calibrations.base import Calibration
from rig.model.calibrations.kinds import KINDS, BinWidths, GalvoModel, GateOpening, Response, TimeZero
from rig.model.calibrations.store import CalibrationStore, doubts, parse
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.pointing import Pointing
from rig.model.quantities import show

Kind = TypeVar("Kind", bound=Calibration)

#: A calibrated delay that differs by more from the configuration's is told.
WORTH_TELLING_S = 50e-12


@dataclass(frozen=True)
class Calibrations:
    """At most one calibration of each kind; where there is none, the configuration's values hold.

    Attributes
    ----------
    records
        By kind.
    warnings
        What speaks against them, as sentences.
    """

    records: Mapping[str, Calibration] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def galvo(self) -> GalvoModel | None:
        """Where the beam meets the wall."""
        return self._one(GalvoModel)

    @property
    def time_zero(self) -> TimeZero | None:
        """When the pulse is on the wall."""
        return self._one(TimeZero)

    @property
    def response(self) -> Response | None:
        """The response of the system."""
        return self._one(Response)

    @property
    def gate(self) -> GateOpening | None:
        """When to open the gate."""
        return self._one(GateOpening)

    @property
    def bin_widths(self) -> BinWidths | None:
        """Real widths of the bins."""
        return self._one(BinWidths)

    def pointing(self, config: RigConfig) -> Pointing:
        """Return the model of the mirror."""
        return self.galvo.pointing() if self.galvo else nominal_pointing(config)

    def legs(self, config: RigConfig) -> PathDelays:
        """Return what to subtract for rectified time."""
        if self.time_zero:
            return self.time_zero.legs
        return PathDelays(
            np.array(self.galvo.mirror_m if self.galvo else config.galvo.position_m),
            np.array(config.spad.position_m),
            config.timing.electronics_delay_s,
        )

    def instrument_response_s(self, config: RigConfig) -> float:
        """Return the full width at half maximum of the response [s]."""
        return self.response.fwhm_s if self.response else config.timing.instrument_response_s

    def gate_s(self, config: RigConfig) -> tuple[float, float]:
        """Return opening after the sync pulse, and width [s]."""
        if self.gate:
            return self.gate.gate_delay_s, self.gate.gate_width_s
        return config.spad.gate_delay_s, config.spad.gate_width_s

    def documents(self) -> dict[str, str]:
        """Return the JSON text of each, as a scan file holds it."""
        return {kind: record.document() for kind, record in self.records.items()}

    def in_words(self) -> str:
        """Return a line about what is used; empty where nothing is."""
        return ", ".join(
            f"{kind} of {record.created:%Y-%m-%d %H:%M}" for kind, record in self.records.items()
        )

    def _one(self, kind: type[Kind]) -> Kind | None:
        record = self.records.get(kind.kind)
        return record if isinstance(record, kind) else None


def nominal_pointing(config: RigConfig) -> Pointing:
    """Return the mirror as the configuration has it: facing the wall squarely, obeying exactly."""
    galvo = config.galvo
    return Pointing(galvo.position_m, mirrors=galvo.mirrors, separation_m=galvo.separation_m)


def choose(config: RigConfig, identities: Mapping[str, str] | None = None) -> Calibrations:
    """Return the newest calibrations of a rig's store that belong to it: to its name and to its devices.

    Parameters
    ----------
    config
        Names the store, or forbids its use.
    identities
        Of the connected devices, by name; None where they are not known yet, and all are taken as the same.

    Raises
    ------
    DataFileError
        If a stored calibration is damaged.
    """
    if not config.calibration.use:
        return Calibrations()
    store = CalibrationStore(config.calibration.folder)
    records: dict[str, Calibration] = {}
    warnings = []
    for kind in KINDS:
        newest = store.newest(kind, rig_name=config.name)
        mine = store.newest(kind, dict(identities or {}), config.name)
        if newest and newest.calibration.simulated != config.simulated:
            newest = mine = None  # a rehearsal's results say nothing of the real rig
        if newest and newest != mine:
            strange = ", ".join(newest.calibration.strangers(dict(identities or {})))
            warnings.append(
                f"{newest.path} belongs to another {strange} and is not used: rig calibrate {kind}"
            )
        if mine:
            records[kind] = mine.calibration
            warnings += filter(None, [doubts(mine.calibration)])
            warnings += [f"the {kind} calibration: {sentence}" for sentence in mine.calibration.warnings]
    return Calibrations(records, (*warnings, *_differences(records, config)))


def recorded(documents: Mapping[str, str], source: Path) -> Calibrations:
    """Read the calibrations that a scan file holds.

    Raises
    ------
    DataFileError
        If one is damaged.
    """
    try:
        return Calibrations({kind: parse(text) for kind, text in documents.items()})
    except ValueError as error:
        raise DataFileError(f"{source}: a calibration in it cannot be read: {error}") from None


def _differences(records: Mapping[str, Calibration], config: RigConfig) -> list[str]:
    """Return where a calibration overrules a configuration that says something else."""
    gate = records.get("gate")
    if not isinstance(gate, GateOpening):
        return []
    wanted_s = config.spad.gate_delay_s
    if math.isclose(gate.gate_delay_s, wanted_s, abs_tol=WORTH_TELLING_S):
        return []
    return [
        f"the gate opens at {show(gate.gate_delay_s, 's', 4)} as calibrated, "
        f"not at {show(wanted_s, 's', 4)} as configured"
    ]
