"""Sphinx: Markdown pages that a code host shows as well, made a site.

The pages know nothing of Sphinx but for ``docs/index.md``. What a site needs beside them is added while
they are read:

- A list of links is a table of contents. The pages that lead to others (`LEADING`) get a hidden table
  of the pages that they link to, in that order; that of a folder also leads to what else is in it.
- Links that leave ``docs/`` go to the site's own copy of that page; those to files are downloads.
"""

import re
from pathlib import Path

from pages_made import write
from sphinx.application import Sphinx

#: Pages whose links are the site's table of contents.
LEADING = {
    "how-to",
    "reference",
    "explanation",
    "tutorial/README",
    "calibration/README",
    "decisions/README",
}
#: Pages of the project that lie beside ``docs/``, and what they are called in the site.
BESIDE = {
    "README.md": "index.md",
    "CHANGELOG.md": "reference/changelog.md",
    "CONTRIBUTING.md": "reference/contributing.md",
}
_LINK = re.compile(r"\]\(([^)#:\s]+\.md)(?:#[^)\s]*)?\)")


def setup(app: Sphinx) -> dict[str, bool]:
    """Add to Sphinx what these pages need."""
    app.connect("builder-inited", _copy_pages_beside)
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}


def _copy_pages_beside(app: Sphinx) -> None:
    docs = Path(app.srcdir)
    for name, page in BESIDE.items():
        if page != "index.md":
            text = (docs.parent / name).read_text(encoding="utf-8")
            write(docs / page, _links_from(text, "../../"))


def _links_from(text: str, root: str) -> str:
    """Return the text of a page of the project's folder with its relative links written from another."""
    return re.sub(r"\]\((?![a-z]+:|#)([^)\s]+)\)", rf"]({root}\1)", text)


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    up = "../" * (name.count("/") + 1)
    for beside, page in BESIDE.items():
        source[0] = source[0].replace(f"]({up}{beside}", f"](/{page}")
    source[0] = source[0].replace(f"]({up}docs/", "](/")
    if name in LEADING:
        source[0] += _contents(name, source[0], Path(app.srcdir))


def _contents(name: str, text: str, docs: Path) -> str:
    """Return the tables of contents of a page: of what it links to, and of what else lies in its folder."""
    page = docs / f"{name}.md"
    linked = dict.fromkeys((page.parent / link).resolve() for link in _LINK.findall(text))
    hidden = [one for one in linked if one.is_relative_to(page.parent)]
    others = sorted(set(page.parent.glob("*.md")) - {page, *hidden}) if page.stem == "README" else []
    return _toctree(docs, hidden, ":hidden:") + (_toctree(docs, others, ":maxdepth: 1") if others else "")


def _toctree(docs: Path, pages: list[Path], option: str) -> str:
    entries = [f"/{one.relative_to(docs).with_suffix('')}" for one in pages]
    return f"\n\n```{{toctree}}\n{option}\n\n" + "\n".join(entries) + "\n```\n"
