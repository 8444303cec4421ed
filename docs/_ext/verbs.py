"""The page of all verbs with their options, from the command line itself."""

import inspect
import re
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_type_hints

import typer
from pages_made import flat, table

from rig.commands import app


def page() -> str:
    """Return the page of all verbs with their options."""
    parts = [
        "# Verbs and their options\n",
        "As `rig VERB --help` has them. A value in capitals is yours to give; quantities carry their unit "
        "(`10ms`, `4cm`). Results go to stdout, everything else to stderr, and `--json` prints exactly "
        "[one document](json.md).\n",
        "| exit code | what it says |\n| --- | --- |",
        *(f"| {code} | {meaning} |" for code, meaning in _exit_codes()),
        "",
    ]
    for words, command in verbs():
        parts += [f"## rig {words}\n", plain(command.help), _usage(words, command), _arguments(command)]
    return "\n".join(parts)


def _exit_codes() -> Iterator[tuple[str, str]]:
    text = " ".join(plain(typer.main.get_command(app).help).partition("Exit codes:")[2].split())
    for one in text.rstrip(".").split(";"):
        code, _, meaning = one.strip().partition(" ")
        yield code, meaning


def verbs(command: Any = None, words: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the words of each verb, and its command, in the order of ``rig --help``."""
    command = command or typer.main.get_command(app)
    inner = getattr(command, "commands", None)
    if inner is None:
        yield words, command
        return
    for name, one in inner.items():
        yield from verbs(one, f"{words} {name}".strip())


def plain(text: str | None) -> str:
    """Return help without the marks of the terminal; its examples become a block."""
    text = re.sub(r"(?<!\\)\[/?(?:bold|dim|b|i)\]", "", inspect.cleandoc(text or "")).replace("\\[", "[")
    text, _, examples = text.partition("Examples\n")
    commands = [line.strip() for line in examples.split("\n") if line.startswith("  ")]
    after = [line for line in examples.split("\n") if line and not line.startswith("  ")]
    block = [re.sub(r"\s{3,}(?=\S)", "   # ", line) for line in commands]
    found = text.strip() + "\n"
    if block:
        found += "\n```sh\n" + "\n".join(block) + "\n```\n"
    return found + ("\n" + "\n".join(after) + "\n" if after else "")


def _usage(words: str, command: Any) -> str:
    arguments = [_asked(one) for one in command.params if one.param_type_name == "argument"]
    return f"\n```text\nrig {' '.join([words, *arguments])} [OPTIONS]\n```\n"


def _asked(argument: Any) -> str:
    name = argument.metavar or argument.name.upper()
    return name if argument.required else f"[{name}]"


def _arguments(command: Any) -> str:
    hints = get_type_hints(inspect.unwrap(command.callback), include_extras=True)
    rows = []
    for one in command.params:
        if one.name == "help" or getattr(one, "hidden", False):
            continue
        meaning, default = _default(one)
        names = (
            [one.metavar or one.name.upper()]
            if one.param_type_name == "argument"
            else [*one.opts, *one.secondary_opts]
        )
        value = "" if getattr(one, "is_flag", False) else _value(one, hints.get(one.name))
        rows.append(("<br>".join(f"`{name}`" for name in names), value, default, meaning))
    return table(("name", "value", "by default", "what it does"), rows)


def _value(one: Any, hint: Any) -> str:
    if one.param_type_name == "argument":
        return ""
    if one.metavar:
        return f"`{one.metavar}`"
    kinds = [kind for kind in flat(hint) if isinstance(kind, type)]
    for kind in kinds:
        if issubclass(kind, Enum):
            return ", ".join(f"`{choice.value}`" for choice in kind)
    words = {int: "a whole number", float: "a number", Path: "a file", str: "text"}
    return words.get(kinds[0], "") if kinds else ""


def _default(one: Any) -> tuple[str, str]:
    """Return what an option does, and its default: the last brackets of its help, or its value."""
    text = (getattr(one, "help", None) or "").replace("\\[", "[")
    found = re.search(r"\s*\[dim\]\[(.*?)\]\[/dim\]\s*$", text)
    meaning = re.sub(r"\[/?(?:bold|dim)\]", "", text[: found.start()] if found else text)
    if found:
        return meaning, found[1]
    value = one.default
    if one.required:
        return meaning, "has to be given"
    if value is None or isinstance(value, bool) or callable(value) or value in ([], ()):
        return meaning, ""
    return meaning, f"`{value.value if isinstance(value, Enum) else value}`"
