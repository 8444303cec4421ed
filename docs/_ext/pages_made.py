"""What the pages that are made from the code have in common."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin


def write(page: Path, text: str) -> None:
    """Write a page that the site makes, unless it is there as it is: then Sphinx need not read it again."""
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.parent.mkdir(exist_ok=True)
        page.write_text(text, encoding="utf-8")


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    header = list(header)
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def first_paragraph(text: str | None) -> str:
    """Return the first paragraph of a docstring, in a line."""
    return " ".join((text or "").strip().split("\n\n")[0].split())


def flat(hint: Any) -> Iterator[Any]:
    """Yield the types that a hint is made of."""
    if get_origin(hint) in (Annotated, Union, UnionType, list, tuple):
        inner = get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint)
        for one in inner:
            yield from flat(one)
    elif hint is not NoneType:
        yield hint
