"""Which calibrations belong to a rig, and what speaks against them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.errors import DataFileError
from rig.model.calibrations.base import Calibration
from rig.model.calibrations.kinds import (
    KINDS,
    BinWidths,
    DarkRates,
    GalvoModel,
    GateOpening,
    MirrorLag,
    Response,
    TimeZero,
)
from rig.model.calibrations.store import CalibrationStore, doubts, parse

Kind = TypeVar("Kind", bound=Calibration)


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
    def lag(self) -> MirrorLag | None:
        """By how much the mirror trails its command."""
        return self._one(MirrorLag)

    @property
    def response(self) -> Response | None:
        """The response of the system."""
        return self._one(Response)

    @property
    def dark(self) -> DarkRates | None:
        """What the detector counts without laser light."""
        return self._one(DarkRates)

    @property
    def gate(self) -> GateOpening | None:
        """When to open the gate."""
        return self._one(GateOpening)

    @property
    def bin_widths(self) -> BinWidths | None:
        """Real widths of the bins."""
        return self._one(BinWidths)

    def without(self, kind: str) -> "Calibrations":
        """Return all but those of a kind."""
        return Calibrations({k: one for k, one in self.records.items() if k != kind}, self.warnings)

    def documents(self) -> dict[str, str]:
        """Return the JSON text of each, as a scan file holds it."""
        return {kind: record.document() for kind, record in self.records.items()}

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the arrays beside these texts, by ``KIND.FIELD``."""
        return {
            f"{kind}.{name}": array
            for kind, record in self.records.items()
            for name, array in record.arrays().items()
        }

    def in_words(self) -> str:
        """Return a line about what is used; empty where nothing is."""
        return ", ".join(
            f"{kind} of {record.created:%Y-%m-%d %H:%M}" for kind, record in self.records.items()
        )

    def _one(self, kind: type[Kind]) -> Kind | None:
        record = self.records.get(kind.kind)
        return record if isinstance(record, kind) else None


def choose(
    store: CalibrationStore, rig_name: str, simulated: bool, identities: Mapping[str, str] | None = None
) -> Calibrations:
    """Return the newest calibrations of a store that belong to a rig: to its name and to its devices.

    Parameters
    ----------
    store
        Where they are kept.
    rig_name, simulated
        The rig; a rehearsal's results say nothing of the real one.
    identities
        Of the connected devices, by name; None where they are not known yet, and all are taken as the same.

    Raises
    ------
    DataFileError
        If a stored calibration is damaged.
    """
    records: dict[str, Calibration] = {}
    warnings: list[str] = []
    for kind in KINDS:
        newest = store.newest(kind, rig_name=rig_name)
        mine = store.newest(kind, dict(identities or {}), rig_name)
        if newest and newest.calibration.simulated != simulated:
            newest = mine = None
        if newest and newest != mine:
            strange = ", ".join(newest.calibration.strangers(dict(identities or {})))
            warnings.append(
                f"{newest.path} belongs to another {strange} and is not used: rig calibrate {kind}"
            )
        if mine:
            records[kind] = mine.calibration
            warnings += [
                f"{path} is dated in the future and is not used: a clock was wrong; remove the file"
                for path in store.from_the_future(kind, rig_name)
                if path != mine.path
            ]
            warnings += filter(None, [doubts(mine.calibration)])
            warnings += [f"the {kind} calibration: {sentence}" for sentence in mine.calibration.warnings]
    return Calibrations(records, tuple(warnings))


def recorded(documents: Mapping[str, str], arrays: Mapping[str, NDArray], source: Path) -> Calibrations:
    """Read the calibrations that a scan file holds, and their arrays, by ``KIND.FIELD``.

    Raises
    ------
    DataFileError
        If one is damaged.
    """
    try:
        return Calibrations({kind: parse(text, _of(kind, arrays)) for kind, text in documents.items()})
    except ValueError as error:
        raise DataFileError(f"{source}: a calibration in it cannot be read: {error}") from None


def _of(kind: str, arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Return the arrays of one kind, by field."""
    return {name.removeprefix(f"{kind}."): one for name, one in arrays.items() if name.startswith(f"{kind}.")}
