"""What pydantic finds wrong with a value, in the words of this program."""

from collections.abc import Callable, Mapping
from typing import Any

#: For each kind of problem: what the value should be, from the bounds that the problem has.
_WANTED: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "int_parsing": lambda _: "a whole number",
    "int_parsing_size": lambda _: "a shorter whole number",
    "int_type": lambda _: "a whole number",
    "int_from_float": lambda _: "a whole number",
    "float_parsing": lambda _: "a number",
    "float_type": lambda _: "a number",
    "finite_number": lambda _: "a finite number",
    "bool_parsing": lambda _: "true or false",
    "bool_type": lambda _: "true or false",
    "string_type": lambda _: "text",
    "path_type": lambda _: "the name of a file",
    "list_type": lambda _: "a list",
    "tuple_type": lambda _: "a list",
    "dict_type": lambda _: "a table",
    "model_type": lambda _: "a table",
    "model_attributes_type": lambda _: "a table",
    "greater_than": lambda bound: f"above {_number(bound['gt'])}",
    "greater_than_equal": lambda bound: f"{_number(bound['ge'])} or more",
    "less_than": lambda bound: f"below {_number(bound['lt'])}",
    "less_than_equal": lambda bound: f"{_number(bound['le'])} or less",
    "literal_error": lambda bound: str(bound["expected"]),
    "enum": lambda bound: str(bound["expected"]),
    "too_short": lambda bound: f"a list of {bound['min_length']} or more",
    "too_long": lambda bound: f"a list of {bound['max_length']} or fewer",
    "string_too_short": lambda bound: f"text of {bound['min_length']} characters or more",
    "string_too_long": lambda bound: f"text of {bound['max_length']} characters or fewer",
}
#: A value is quoted up to so many characters.
_LONGEST = 60


def in_words(problem: Mapping[str, Any]) -> str:
    """Return what is wrong with a value: what it is, and what it should be.

    Parameters
    ----------
    problem
        One of ``ValidationError.errors()``.
    """
    kind = problem["type"]
    if kind == "missing":
        return "is missing; add it"
    wanted = _WANTED.get(kind)
    if wanted is None:
        return str(problem["msg"]).removeprefix("Value error, ")
    return f"{_shown(problem['input'])} is not {wanted(problem.get('ctx', {}))}"


def _number(bound: Any) -> str:
    return f"{bound:g}" if isinstance(bound, int | float) else str(bound)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
