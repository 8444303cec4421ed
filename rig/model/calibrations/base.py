"""What every calibration says of itself, whatever it found."""

import hashlib
import json
from datetime import UTC, datetime, timedelta
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

import rig

#: Longest time that a calibration may be good for, a century.
MOST_DAYS = 36525
#: Clocks of computers and time zones that were set wrong differ by this much at most.
CLOCKS_DIFFER = timedelta(days=1)


def utc_now() -> datetime:
    """Return the present time, UTC, to the second."""
    return datetime.now(UTC).replace(microsecond=0)


class Calibration(BaseModel):
    """A dated result that belongs to certain devices.

    The subclasses in `rig.model.calibrations.kinds` add what was found; SI units throughout, the unit in the
    name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    #: How the commands and files call this kind.
    kind: ClassVar[str]
    #: The devices, by their names in a scan file, whose exchange makes a calibration of this kind void.
    belongs_to: ClassVar[tuple[str, ...]]
    #: Fields of so many numbers that they are kept as arrays beside the text; a missing number is NaN there.
    bulky: ClassVar[tuple[str, ...]] = ()

    created: AwareDatetime = Field(default_factory=utc_now)
    valid_days: float = Field(gt=0, le=MOST_DAYS)
    software: str = f"nlos-rig {rig.__version__}"
    rig_name: str
    """Name of the rig."""
    devices: dict[str, str]
    """Identity of each device that it belongs to, by name."""
    measured_from: dict[str, str]
    """SHA-256 of each file that it was computed from, by name."""
    simulated: bool = False
    warnings: list[str] = Field(default_factory=list)
    """Known doubts about it, as sentences."""

    @property
    def expires(self) -> datetime:
        """When it is to be measured again."""
        try:
            return self.created + timedelta(days=self.valid_days)
        except OverflowError:  # after the year 9999
            return datetime.max.replace(tzinfo=UTC)

    def is_old(self, now: datetime) -> bool:
        """Return whether it is to be measured again."""
        return now > self.expires

    def is_from_the_future(self, now: datetime) -> bool:
        """Return whether it is dated later than clocks of two computers differ: one of them was wrong."""
        return self.created > now and self.created - now > CLOCKS_DIFFER

    def strangers(self, identities: dict[str, str]) -> list[str]:
        """Return which of its devices are others among ``identities``; what is not named is not compared."""
        return [name for name, mine in self.devices.items() if identities.get(name, mine) != mine]

    def document(self) -> str:
        """Return the JSON text that is stored; its digest covers all the rest, and that of each array."""
        content = {"kind": self.kind, **self.model_dump(mode="json", exclude=set(self.bulky))}
        if self.bulky:
            content["arrays"] = {name: digest_of_array(array) for name, array in self.arrays().items()}
        return json.dumps({**content, "digest": digest(content)}, indent=1)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the fields that are kept as arrays, by name."""
        return {
            name: np.array([np.nan if one is None else one for one in getattr(self, name)], float)
            for name in self.bulky
        }


def digest_of_array(array: NDArray[np.float64]) -> str:
    """Return the SHA-256 of an array's numbers as little-endian float64, hexadecimal."""
    return hashlib.sha256(np.ascontiguousarray(array, "<f8").tobytes()).hexdigest()


def digest(content: dict) -> str:
    """Return the SHA-256 of a calibration's content, written in one fixed way; hexadecimal."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
