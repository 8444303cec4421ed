"""What can go wrong with a device.

    DeviceError                 any failure of a device
    ├── DeviceNotFoundError     nothing there, or something else is there
    ├── LinkError               the wire broke, or no answer came in time
    ├── ProtocolError           an answer came that the protocol does not allow
    ├── RefusedError            the device understood and refused
    │   └── FoundEmittingError  a laser was emitting when it was opened, and is dark now
    └── LimitError              the request is outside the limits; nothing was sent

Every error names the device, what was asked, what came back, and what to do about it.
"""


class DeviceError(Exception):
    """Any failure of a device.

    Parameters
    ----------
    device : str
        The device and where it is, e.g. ``"galvo at /dev/ttyACM0"``.
    asked : str
        What was asked of it.
    answered : str
        What came back, or what was missing.
    remedy : str
        What a person can do about it.
    """

    def __init__(self, device: str, asked: str, answered: str, remedy: str) -> None:
        super().__init__(f"{device}: asked to {asked}, but {answered}. {remedy}")
        self.device = device
        self.asked = asked
        self.answered = answered
        self.remedy = remedy


class DeviceNotFoundError(DeviceError):
    """Raised when nothing answers at the address, or a different device does."""


class LinkError(DeviceError):
    """Raised when the wire breaks or an answer does not come in time."""


class ProtocolError(DeviceError):
    """Raised when an answer comes that the protocol does not allow."""


class RefusedError(DeviceError):
    """Raised when the device understood the request and refused it."""


class FoundEmittingError(RefusedError):
    """Raised when a laser was found emitting on connect; it has been switched off, and has confirmed that."""


class LimitError(DeviceError):
    """Raised when a request is outside the limits, before anything is sent."""
