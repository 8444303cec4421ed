"""A laser behind a shutter: there is light while both let it out, and none when the shutter is closed."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from drivers.leaving import leave
from rig.devices.by_hand import UnseenLaser
from rig.devices.kinds import LASERS, SHUTTERS, Wires
from rig.model.config import ExternalLaserConfig, RigConfig
from rig.model.devices import Laser, Settings, Shutter


class BehindShutter:
    """A laser and the shutter in its beam, as one laser; a context manager that leaves both closed.

    Both are open as devices already; the shutter is closed.

    Parameters
    ----------
    laser, shutter
        The two.
    """

    def __init__(self, laser: Laser, shutter: Shutter) -> None:
        self._laser = laser
        self._shutter = shutter

    @property
    def identity(self) -> str:
        """Both, as they report themselves."""
        return f"{self._laser.identity}; behind {self._shutter.identity}"

    def arm(self) -> None:
        """Close the shutter, then prepare the laser."""
        self._shutter.close()
        self._laser.arm()

    def emit(self) -> None:
        """Let the laser emit, then open the shutter; both are confirmed."""
        try:
            self._laser.emit()
            self._shutter.let_through()
        except BaseException as problem:
            leave([self.stop], problem)
            raise

    def stop(self) -> None:
        """Close the shutter and end the laser's emission; each is tried, whatever the other says.

        Raises
        ------
        DeviceError
            If one of them does not confirm it.
        """
        leave([self._shutter.close, self._laser.stop], None)

    def emitting(self) -> bool:
        """Return whether light comes out, asked now."""
        return self._laser.emitting() and self._shutter.is_open()

    def settings(self) -> Settings:
        """Return those of the laser, and where the shutter is."""
        shutter = {f"shutter_{name}": value for name, value in self._shutter.settings().items()}
        return {**self._laser.settings(), **shutter, "identity": self.identity, "emitting": self.emitting()}


@contextmanager
def open_laser(config: RigConfig, wires: Wires) -> Iterator[Laser]:
    """Open the laser, behind its shutter where there is one; leave it dark at the end.

    The laser is opened first: it is dark then, should the shutter's line move while that is opened.

    Raises
    ------
    drivers.errors.DeviceError
        If one of them is missing, is another one, or fails.
    """
    section, shutter = config.laser, config.shutter
    with ExitStack() as stack:
        if shutter is None:
            yield stack.enter_context(LASERS.of(section).open(section, wires))
            return
        laser: Laser
        if isinstance(section, ExternalLaserConfig):
            laser = UnseenLaser(section.model)
        else:
            laser = stack.enter_context(LASERS.of(section).open(section, wires))
        yield BehindShutter(laser, stack.enter_context(SHUTTERS.of(shutter).open(shutter, wires)))
