"""Leaving a device safe: every step is tried, and no failure hides another."""

from collections.abc import Callable, Iterable


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
