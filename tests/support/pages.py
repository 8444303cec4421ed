"""The project's pages: their blocks of code, their links, their headings."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_FENCE = re.compile(
    r"(?:^<!-- not run: (?P<reason>[^\n]*) -->\n)?"
    r"^```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block of code on a page.

    Attributes
    ----------
    page, line
        Where it is.
    language
        The word behind the fence.
    reason
        Why it is not run here: the comment ``<!-- not run: REASON -->`` above it.
    """

    page: str
    line: int
    language: str
    text: str
    reason: str | None

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def pages() -> list[Path]:
    """Return the README and all pages that say how something is done; not decisions, and no changes."""
    docs = ROOT / "docs"
    left_out = {docs / "decisions", docs / "reference"}
    return [
        ROOT / "README.md",
        *(page for page in sorted(docs.rglob("*.md")) if not left_out & set(page.parents)),
    ]


def blocks(*languages: str) -> list[Block]:
    """Return all fenced blocks in these languages."""
    return [
        Block(
            str(page.relative_to(ROOT)),
            text.count("\n", 0, found.start("text")),
            found["language"],
            found["text"],
            found["reason"],
        )
        for page in pages()
        for text in [page.read_text(encoding="utf-8")]
        for found in _FENCE.finditer(text)
        if found["language"] in languages
    ]


def commands(block: Block) -> Iterator[list[str]]:
    """Return the words of each command of a shell block, without comments."""
    for line in block.text.replace("\\\n", " ").splitlines():
        for part in re.split(r"\s&&\s", line):
            if words := shlex.split(part, comments=True):
                yield [words[0].removeprefix(".venv/bin/"), *words[1:]]
