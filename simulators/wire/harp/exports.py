"""Python functions as C functions: prototypes, remembered exceptions, answers.

An exception inside a ctypes callback is swallowed, and the caller receives a random positive number. So
nothing may leave a callback but an int that was meant.
"""

from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, c_char, c_double, c_int, c_uint, c_void_p, memmove
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from simulators.wire.harp.codes import Code
from simulators.wire.harp.families import SimulatedFamily

INT, UINT, BUFFER = c_int, c_uint, c_void_p
TEXT_OUT, INT_OUT, UINT_OUT, DOUBLE_OUT = POINTER(c_char), POINTER(c_int), POINTER(c_uint), POINTER(c_double)


class Answer(Exception):  # noqa: N818 - an error code of the simulated library, not an error of ours
    """Raised inside a function to return this code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = int(code)


class WrongArgument(Exception):  # noqa: N818 - as `Answer`
    """Raised inside a function where its argument at this place, counted from 1, is not to be had."""

    def __init__(self, place: int) -> None:
        super().__init__(place)
        self.place = place


@dataclass(frozen=True)
class Export:
    """One C function: its name, the types of its arguments, the Python function, and who has it."""

    name: str
    types: tuple[Any, ...]
    function: Callable[..., None]
    where: Callable[[SimulatedFamily], bool]


class Exports(list[Export]):
    """C functions in the order of their declaration, without the prefix of a family."""

    def declare(
        self, name: str, *types: Any, where: Callable[[SimulatedFamily], bool] = lambda family: True
    ) -> Callable[[Callable[..., None]], Callable[..., None]]:
        """Export the decorated function, which takes the connection before its C arguments.

        Parameters
        ----------
        name, types
            Of the C function.
        where
            Tells which families have it, and have it so.
        """

        def decorate(function: Callable[..., None]) -> Callable[..., None]:
            self.append(Export(name, types, function, where))
            return function

        return decorate


def as_c_functions(
    exports: Exports, family: SimulatedFamily, first: object, remember: Callable[[BaseException], None]
) -> SimpleNamespace:
    """Make a family's C function pointers, alive as long as the returned object, which act on ``first``."""
    return SimpleNamespace(
        **{
            f"{family.prefix}_{e.name}": CFUNCTYPE(c_int, *e.types)(
                _guarded(e.function, family, first, remember)
            )
            for e in exports
            if e.where(family)
        }
    )


def _guarded(
    function: Callable[..., None],
    family: SimulatedFamily,
    first: object,
    remember: Callable[[BaseException], None],
) -> Callable[..., int]:
    def guarded(*arguments: Any) -> int:
        try:
            function(first, *arguments)
        except Answer as answer:
            return answer.code
        except WrongArgument as wrong:
            return -200 - wrong.place if family.says_which_argument else int(Code.INVALID_ARGUMENT)
        except ConnectionError:  # the bench was in another process, and is gone
            return int(Code.USB_VCMD_FAIL)
        except BaseException as error:  # Ctrl-C too: whatever leaves a callback is lost
            remember(error)
            return int(Code.EXCEPTION)
        return 0

    return guarded


def require(condition: bool, code: Code) -> None:
    """Answer with ``code`` unless the condition holds."""
    if not condition:
        raise Answer(code)


def take(condition: bool, place: int) -> None:
    """Answer that the argument at ``place`` is wrong unless the condition holds."""
    if not condition:
        raise WrongArgument(place)


def write_text(into: Any, text: str) -> None:
    """Write a C string."""
    data = text.encode("ascii") + b"\0"
    memmove(into, data, len(data))
