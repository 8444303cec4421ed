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

INT, UINT, BUFFER = c_int, c_uint, c_void_p
TEXT_OUT, INT_OUT, UINT_OUT, DOUBLE_OUT = POINTER(c_char), POINTER(c_int), POINTER(c_uint), POINTER(c_double)


class Answer(Exception):  # noqa: N818 - an error code of the simulated library, not an error of ours
    """Raised inside a function to return this code."""

    def __init__(self, code: Code) -> None:
        super().__init__(code)
        self.code = int(code)


@dataclass(frozen=True)
class Export:
    """One C function: its name, the types of its arguments, and the Python function behind it."""

    name: str
    types: tuple[Any, ...]
    function: Callable[..., None]


class Exports(list[Export]):
    """C functions in the order of their declaration."""

    def declare(self, name: str, *types: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
        """Export the decorated function, which takes the connection before its C arguments."""

        def decorate(function: Callable[..., None]) -> Callable[..., None]:
            self.append(Export(name, types, function))
            return function

        return decorate


def as_c_functions(
    exports: Exports, first: object, remember: Callable[[BaseException], None]
) -> SimpleNamespace:
    """Make C function pointers, alive as long as the returned object; ``first`` is what they act on."""
    return SimpleNamespace(
        **{e.name: CFUNCTYPE(c_int, *e.types)(_guarded(e.function, first, remember)) for e in exports}
    )


def _guarded(
    function: Callable[..., None], first: object, remember: Callable[[BaseException], None]
) -> Callable[..., int]:
    def guarded(*arguments: Any) -> int:
        try:
            function(first, *arguments)
        except Answer as answer:
            return answer.code
        except ConnectionError:  # the bench was in another process, and is gone
            return int(Code.USB_VCMD_FAIL)
        except BaseException as error:  # Ctrl-C too: whatever leaves a callback is lost
            remember(error)
            return int(Code.EXCEPTION)
        return 0

    return guarded


def require(condition: bool, code: Code = Code.INVALID_ARGUMENT) -> None:
    """Answer with ``code`` unless the condition holds."""
    if not condition:
        raise Answer(code)


def write_text(into: Any, text: str) -> None:
    """Write a C string."""
    data = text.encode("ascii") + b"\0"
    memmove(into, data, len(data))
