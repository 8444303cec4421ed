"""Kinds of devices that installed packages bring, by entry points of the group ``rig.devices``."""

from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Protocol

from rig.errors import ConfigError
from rig.model.config.section import DeviceSection

GROUP = "rig.devices"


class InstalledKind(Protocol):
    """What an entry point leads to, as far as a configuration needs it."""

    @property
    def section(self) -> type[DeviceSection]:
        """The section of the configuration."""
        ...

    @property
    def simulated(self) -> Callable[[Any], Any] | None:
        """Makes the device's firmware, of a simulated bench; None where it has none."""
        ...


@cache
def names(role: str) -> list[str]:
    """Return the kinds that installed packages bring for a role such as ``laser``."""
    found = (entry.name.partition(".") for entry in entry_points(group=GROUP))
    return sorted(kind for of_role, _, kind in found if of_role == role and kind)


@cache
def installed(role: str, kind: str, base: type[DeviceSection]) -> InstalledKind | None:
    """Load a kind that an installed package brings, or None where none does.

    Parameters
    ----------
    role, kind
        The entry point is named ``role.kind``.
    base
        What its section has to be derived from.

    Raises
    ------
    ConfigError
        If the package cannot be loaded, two packages bring the kind, or it is no kind of this role.
    """
    entries = list(entry_points(group=GROUP, name=f"{role}.{kind}"))
    if not entries:
        return None
    package = " and ".join(sorted(str(entry.dist.name) if entry.dist else entry.value for entry in entries))
    if len(entries) > 1:
        raise ConfigError(f"{role}.kind = '{kind}' is provided by {package}: remove all but one")
    try:
        found: InstalledKind = entries[0].load()
        section = found.section
    except Exception as problem:  # whatever a package of others does wrong
        raise ConfigError(
            f"{role}.kind = '{kind}' of the package {package} cannot be loaded: "
            f"{type(problem).__name__}: {problem}. Ask its author, or install its newest version"
        ) from problem
    if not (isinstance(section, type) and issubclass(section, base)):
        raise ConfigError(
            f"{role}.kind = '{kind}' of the package {package}: its section is not a {base.__name__}. "
            "Ask its author"
        )
    return found
