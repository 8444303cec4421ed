"""A kind of device: what a configuration says of it, and what opens it."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar, cast

from rig.devices.kinds.wires import Wires
from rig.model.config import DeviceSection
from rig.model.config.kinds import ROLES

D = TypeVar("D")


def anything_goes(section: Any) -> None:
    """Allow every setting: the device itself refuses what it cannot do."""


@dataclass(frozen=True)
class Kind(Generic[D]):
    """A kind of device.

    Attributes
    ----------
    section
        Its section of the configuration.
    open
        Of that section and the wires; gives the device, to be entered.
    check
        Of that section; raises `drivers.errors.LimitError` unless the device can be set so.
    simulated
        Of a simulated bench (`simulators.bench.Bench`); gives the device's firmware at the end of its serial
        line. For lasers that installed packages bring.
    """

    section: type[DeviceSection]
    open: Callable[[Any, Wires], AbstractContextManager[D]]
    check: Callable[[Any], object] = anything_goes
    simulated: Callable[[Any], Any] | None = None


class Sectioned(Protocol):
    """Any kind: it knows its section."""

    @property
    def section(self) -> type[DeviceSection]:
        """The section of the configuration."""
        ...


K = TypeVar("K", bound=Sectioned)


class Kinds(Generic[K]):
    """The kinds of a role.

    Parameters
    ----------
    role
        A key of `rig.model.config.kinds.ROLES`.
    *kinds
        The program's own.

    Attributes
    ----------
    sections
        Those of the program's own kinds.
    """

    def __init__(self, role: str, *kinds: K) -> None:
        self._role = ROLES[role]
        self._own = {kind.section: kind for kind in kinds}
        self.sections = list(self._own)

    def of(self, section: DeviceSection) -> K:
        """Return the kind of a section, which an installed package may have brought."""
        return self._own.get(type(section)) or cast("K", self._role.installed(section.kind))
