"""A laser behind a shutter: there is light while both let it out, and none when the shutter is closed."""

from drivers.leaving import leave
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
