"""The light in words; and failures of devices, as words that are sent from one process to another."""

from drivers import errors
from drivers.errors import DeviceError
from rig.model.config import RigConfig


def light_in_words(config: RigConfig) -> str:
    """Return which laser is lit, where, how strong and how often."""
    laser = config.laser
    return (
        f"the laser of {config.name} at {config.light_place}: {laser.power_in_words}, "
        f"{laser.repetition_hz / 1e6:g} MHz"
    )


def as_error(problem: DeviceError) -> dict[str, str]:
    """Return a failure as words."""
    return {
        "kind": type(problem).__name__,
        "device": problem.device,
        "asked": problem.asked,
        "answered": problem.answered,
        "remedy": problem.remedy,
        "notes": "\n".join(getattr(problem, "__notes__", [])),
    }


def from_words(words: dict[str, str]) -> DeviceError:
    """Return the failure that `as_error` was given; of an unknown kind it is a `DeviceError`."""
    kind = getattr(errors, words["kind"], DeviceError)
    if not (isinstance(kind, type) and issubclass(kind, DeviceError)):
        kind = DeviceError
    problem: DeviceError = kind(words["device"], words["asked"], words["answered"], words["remedy"])
    if words.get("notes"):
        problem.add_note(words["notes"])
    return problem
