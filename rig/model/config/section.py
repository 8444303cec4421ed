"""What all sections of a configuration share."""

from pathlib import Path
from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict, model_validator

from rig.errors import printable
from rig.model.quantities import Metres

_UNIT_SUFFIXES = ("_s", "_m", "_hz", "_rad", "_v", "_w")

Point = tuple[Metres, Metres, Metres]


def _key(name: str) -> str:
    """Name a field in a file: without its unit, because there the value carries it."""
    return next((name.removesuffix(s) for s in _UNIT_SUFFIXES if name.endswith(s)), name)


def _storable(text: str) -> bool:
    return text == text.encode("utf-8", "ignore").decode("utf-8")


class Section(BaseModel):
    """A section: nothing in it changes, and nothing in a file is left unread."""

    model_config = ConfigDict(frozen=True, extra="forbid", alias_generator=_key, populate_by_name=False)

    @model_validator(mode="after")
    def _is_text(self) -> Self:
        """Refuse what no scan file can record, as the name of a file whose bytes are not UTF-8."""
        for name, value in self:
            if isinstance(value, str | Path) and not _storable(str(value)):
                raise ValueError(f"{_key(name)} '{printable(str(value))}' is not UTF-8 text; rename the file")
        return self


class DeviceSection(Section):
    """A section of which there are several kinds."""

    #: Whether the device has no address but the one that is written down.
    needs_address: ClassVar[bool] = False

    kind: str


def require_ceiling(key: str, asked: float, ceiling: float) -> None:
    """Raise `ValueError` where more is asked for than the rig's own ceiling."""
    if asked > ceiling:
        raise ValueError(f"{key} {asked:g} is above the rig's limit max_{key} {ceiling:g}")
