"""What a configuration says in all, and where each value comes from."""

from collections.abc import Iterator
from dataclasses import dataclass

from pydantic import BaseModel

from rig.model.config import RigConfig
from rig.model.config.inherited import Place, Written
from rig.model.spelled import spelled


@dataclass(frozen=True)
class Value:
    """A value of a configuration.

    Attributes
    ----------
    key
        With its section, e.g. ``galvo.address``.
    text
        The value, as TOML has it; empty where it is not set.
    origin
        The file that says it; ``default`` where none does.
    """

    key: str
    text: str
    origin: str


def values(config: RigConfig, written: Written | None) -> Iterator[Value]:
    """Return all values of a rig.

    Parameters
    ----------
    config
        The rig.
    written
        The files that give it; None for the built-in rig.
    """
    yield from _values(config, written, "", ())


def _values(section: BaseModel, written: Written | None, name: str, place: Place) -> Iterator[Value]:
    for field, about in type(section).model_fields.items():
        value, key = getattr(section, field), about.alias or field
        inside, path = (*place, key), f"{name}.{key}" if name else key
        if about.exclude:  # what no data file holds: addresses of people, which may be secret
            yield Value(path, "(not shown)", _origin(inside, written))
        elif isinstance(value, BaseModel):
            yield from _values(value, written, path, inside)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            for number, one in enumerate(value):
                yield from _values(one, written, f"{path}[{number}]", inside)
        else:
            text = "" if value is None else spelled(value, field)
            yield Value(path, text, _origin(inside, written))


def _origin(place: Place, written: Written | None) -> str:
    """Return the file that says a key; that of a list, for what stands in the list."""
    if written is None:
        return "built-in"
    for one in (place, place[:1]):
        if one in written.files and not (one != place and isinstance(written.table.get(one[0]), dict)):
            return str(written.files[one])
    return "default"
