"""Wrong options and arguments in the words of this program: the thing, the value, and what to do."""

from difflib import get_close_matches
from typing import Any


def is_of_usage(error: Exception) -> bool:
    """Return whether the parser of the command line raised this, of whichever version it is."""
    return hasattr(error, "format_message") and hasattr(error, "exit_code")


def is_missing_verb(error: Exception) -> bool:
    """Return whether a command was called without its verb; its help was printed then."""
    return type(error).__name__ == "NoArgsIsHelpError"


def in_words(error: Any) -> str:
    """Return what is wrong with a command line."""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "rig"
    verb, problem = path.removeprefix("rig").strip(), _problem(error)
    told = f"{verb}: {problem}" if verb else problem
    return f"{told}{'' if told.endswith('?') else '.'} See: {path} --help"


def _problem(error: Any) -> str:
    if is_missing_verb(error):
        return "it needs a verb, one of the list"
    if hasattr(error, "possibilities"):
        return _no_such_option(error)
    parameter = getattr(error, "param", None)
    message = str(error.message).removeprefix("Value error, ").rstrip(".")
    if type(error).__name__ == "MissingParameter" and parameter is not None:
        return f"{_name(parameter)} is missing; give it"
    if parameter is not None:
        return f"{_name(parameter)}: {_of_value(error) or message}"
    return f"{message[:1].lower()}{message[1:]}"


def _no_such_option(error: Any) -> str:
    """Return the message for an unknown option, with those alone that are nearly spelled so."""
    name = error.option_name
    known = (
        [option for parameter in error.ctx.command.params for option in parameter.opts] if error.ctx else []
    )
    near = get_close_matches(name, known, n=2, cutoff=0.7)
    return f"it has no option {name}" + (f"; did you mean {' or '.join(near)}?" if near else "")


def _name(parameter: Any) -> str:
    """Return what a person calls a parameter: its long option, or the word of its place."""
    if parameter.param_type_name == "option":
        return max(parameter.opts, key=len)
    return str(parameter.metavar or parameter.name.upper())


def _of_value(error: Any) -> str:
    """Return what is wrong with a value, where the parser had pydantic look at it."""
    problems = getattr(error.__cause__, "errors", None)
    if problems is None:
        return ""
    from rig.model.problems import in_words as in_our_words

    return in_our_words(problems()[0]).rstrip(".")
