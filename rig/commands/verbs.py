"""What all verbs have: how they show their help, and the options for what is said."""

from collections.abc import Callable
from inspect import Parameter, cleandoc, signature
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from rig.commands.options import EVERY
from rig.commands.voice import voice

#: Options whose value is text for people: an empty one says that there is nothing to say.
MAY_BE_EMPTY = frozenset({"operator", "sample", "purpose", "note"})


class _Tidy:
    """Help in which a flag is its name alone, with no type behind it; values that are empty are refused."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.help: str | None = _flowing(self.help or "")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse values that are empty, as of a shell variable that is not set, and read the others."""
        given, _, _ = self.make_parser(ctx).parse_args(args=list(args))  # type: ignore[attr-defined]
        for one in self.get_params(ctx):
            value = given.get(one.name)
            if one.name not in MAY_BE_EMPTY and "" in (value if isinstance(value, list | tuple) else [value]):
                raise typer.BadParameter("its value is empty; give one, or leave it out", ctx=ctx, param=one)
        return super().parse_args(ctx, args)  # type: ignore[misc]

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the options and arguments, that for help among them."""
        parameters = super().get_params(ctx)  # type: ignore[misc]
        for one in parameters:
            if getattr(one, "is_flag", False):
                one.metavar = ""
            if one.name == "help":
                one.rich_help_panel = EVERY
        return list(parameters)


def _flowing(text: str) -> str:
    """Return help whose paragraphs have no line ends of the source; lines of an example keep theirs."""
    paragraphs = cleandoc(text).split("\n\n")
    return "\n\n".join(one if one.startswith("  ") else " ".join(one.split()) for one in paragraphs)


class Verb(_Tidy, TyperCommand):
    """A verb."""


class Verbs(_Tidy, TyperGroup):
    """Several verbs under one name."""


def _quiet(wanted: bool) -> None:
    voice.choose(quiet=wanted)


def _verbose(wanted: bool) -> None:
    voice.choose(verbose=wanted)


def _log(path: Path | None) -> None:
    if path is not None:
        voice.keep_in(path)


#: Options that every verb has, and the program before it: a callback sees to each, the verb knows nothing.
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=_quiet,
        is_eager=True,
        expose_value=False,
        rich_help_panel=EVERY,
        help="Show only results, errors, and messages about the light.",
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        callback=_verbose,
        is_eager=True,
        expose_value=False,
        rich_help_panel=EVERY,
        help="Also show each action, with its time.",
    ),
]
Log = Annotated[
    Path | None,
    typer.Option(
        "--log",
        metavar="FILE",
        callback=_log,
        is_eager=True,
        expose_value=False,
        rich_help_panel=EVERY,
        help="Append all messages to this file, with their times.",
    ),
]
COMMON = (
    Parameter("quiet", Parameter.KEYWORD_ONLY, default=False, annotation=Quiet),
    Parameter("verbose", Parameter.KEYWORD_ONLY, default=False, annotation=Verbose),
    Parameter("log", Parameter.KEYWORD_ONLY, default=None, annotation=Log),
)


def alike(app: typer.Typer) -> None:
    """Give all verbs of an application, and of the groups in it, the options and the help of all."""
    for command in app.registered_commands:
        own = command.cls
        command.cls = Verb if own is None or issubclass(Verb, own) else type("Verb", (own, Verb), {})
        command.callback = _with_common(command.callback)
    for group in app.registered_groups:
        group.cls = Verbs
        assert group.typer_instance is not None
        alike(group.typer_instance)


def _with_common(verb: Callable[..., Any] | None) -> Callable[..., Any]:
    """Return a verb that has the common options, but for those of which it has one of that name."""
    assert verb is not None
    own = signature(verb, eval_str=True).parameters

    def with_common(**options: Any) -> Any:
        return verb(**{name: value for name, value in options.items() if name in own})

    extra = [one for one in COMMON if one.name not in own]
    with_common.__doc__, with_common.__name__ = verb.__doc__, verb.__name__
    with_common.__signature__ = signature(verb, eval_str=True).replace(  # type: ignore[attr-defined]
        parameters=[*own.values(), *extra]
    )
    return with_common
