"""Leaving a device safe: every step is tried, again if need be, and no failure hides another."""

from collections.abc import Callable, Iterable

from drivers.errors import DeviceError

#: So often a device is made safe before it is said not to be.
TRIES = 3


def leave(steps: Iterable[Callable[[], None]], during: BaseException | None) -> None:
    """Run all ``steps`` in order, also when one fails.

    `contextlib.ExitStack` runs all its callbacks too, but the last failure takes the place of the exception
    that was on its way. Here that exception goes on, the same object, and what failed while leaving is told
    on it as notes: "treat the laser as emitting" must not be lost, nor hide what went wrong first.

    Parameters
    ----------
    steps
        What leaves the device safe, the most urgent first.
    during
        The exception that is already on its way, or None.

    Raises
    ------
    BaseException
        The first failure, with the later ones noted on it, if nothing was on its way. Otherwise all failures
        are noted on ``during``, which goes on.
    """
    failures: list[BaseException] = []
    for step in steps:
        try:
            step()
        except BaseException as failure:  # even an interrupt must not skip the steps that follow
            failures.append(failure)
    if not failures:
        return
    told = during if during is not None else failures.pop(0)
    for other in failures:
        told.add_note(f"while leaving: {other}")
    if told is not during:
        raise told


def insist(
    attempt: Callable[[], object],
    *,
    name: str,
    asked: str,
    beware: str,
    tries: int = TRIES,
    otherwise: Iterable[Callable[[], None]] = (),
) -> None:
    """Make a device safe: neither a garbled answer nor an interrupt must leave it as it is.

    Parameters
    ----------
    attempt
        Makes it safe and verifies that; it is called again after any exception.
    name, asked
        The device, and what it was to do, for messages.
    beware
        What a person has to do if it may not be safe.
    tries
        How often it is tried.
    otherwise
        The next best, if all attempts failed.

    Raises
    ------
    DeviceError
        The last one of the attempts, with the words of ``asked`` and ``beware``, if all failed.
    BaseException
        An interrupt that came meanwhile, when the device is safe; or the last one, if all attempts failed.
    """
    interrupted: BaseException | None = None
    for number in range(1, tries + 1):
        try:
            attempt()
            break
        except DeviceError as problem:
            doubt: BaseException = type(problem)(name, asked, problem.answered, beware)
        except BaseException as problem:
            doubt = interrupted = problem
        if number == tries:
            leave(otherwise, doubt)
            raise doubt
    if interrupted is not None:
        raise interrupted
