"""Pages for a browser: one file each, without scripts, and with every text escaped.

What is text stays text: `element` escapes all that is not `Html`, and nothing else makes `Html` of what comes
from a file. `page` forbids scripts and all that lies outside of the file, too.
"""

import base64
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from matplotlib.figure import Figure

from rig.errors import printable
from rig.show.saving import DPI

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1c2430; background: #fff; margin: 0 auto;
  padding: 1.5rem; max-width: 62rem; overflow-wrap: anywhere; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .7rem; padding-bottom: .25rem; border-bottom: 1px solid #d5dbe3; }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
p { margin: .5rem 0; }
a { color: #175a9e; }
.lead { color: #55606e; margin-top: 0; }
.badge { display: inline-block; padding: 0 .6rem; border-radius: 1rem; background: #e7ecf2;
  font-weight: 600; }
.badge.complete { background: #d9efdf; } .badge.failed { background: #f8d7d5; }
.badge.interrupted, .badge.running { background: #fcebc4; }
dl { display: grid; grid-template-columns: minmax(8rem, max-content) 1fr; gap: .2rem 1.2rem;
  margin: .4rem 0; }
dt { color: #55606e; } dd { margin: 0; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr)); gap: .4rem 2rem; }
.cards dl { grid-template-columns: minmax(6rem, 45%) 1fr; font-size: .9rem; gap: .1rem .8rem; }
table { border-collapse: collapse; width: 100%; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .9rem .3rem 0;
  border-bottom: 1px solid #e7ecf2; }
th { color: #55606e; font-weight: 600; white-space: nowrap; }
figure { margin: .8rem 0; } figure img { width: 100%; height: auto; display: block; }
figcaption { color: #55606e; font-size: .9rem; margin-top: .3rem; }
pre { background: #f4f6f9; border-radius: .3rem; padding: .8rem; font-size: .85rem; white-space: pre-wrap; }
code { font-family: ui-monospace, monospace; font-size: .9em; }
ul.warnings { background: #fcebc4; border-radius: .3rem; padding: .7rem .9rem .7rem 2rem; margin: .7rem 0; }
@media (max-width: 40rem) {
  body { padding: 1rem .8rem; } h1 { font-size: 1.35rem; }
  dl { grid-template-columns: minmax(6rem, 30%) 1fr; gap: .2rem .8rem; }
  thead { display: none; } tr { display: block; padding: .4rem 0; border-bottom: 1px solid #e7ecf2; }
  td { display: grid; grid-template-columns: minmax(6rem, 30%) 1fr; padding: .1rem 0; border: 0; }
  td::before { content: attr(data-is); color: #55606e; }
}
@media print {
  @page { margin: 15mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  h2 { break-after: avoid; } figure, tr, .cards > section { break-inside: avoid; }
  pre, .badge, ul.warnings { border: 1px solid #d5dbe3; }
}
"""


class Html(str):
    """Text that is HTML already, and is not escaped again."""


def element(name: str, /, *content: str, **attributes: str) -> Html:
    """Return an element.

    Parameters
    ----------
    name
        Of the element.
    content
        What is in it; all that is not `Html` is escaped.
    attributes
        Of the element, escaped; their names as Python can write them: ``class_``, ``http_equiv``.
    """
    told = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_text(value)}"' for key, value in attributes.items()
    )
    if name in {"img", "meta"}:
        return Html(f"<{name}{told}>")
    return Html(f"<{name}{told}>{''.join(map(_part, content))}</{name}>")


def join(parts: Iterable[str]) -> Html:
    """Return parts one after the other; what is no `Html` is escaped."""
    return Html("\n".join(map(_part, parts)))


def facts(told: Mapping[str, str]) -> Html:
    """Return labels and what they say."""
    return element("dl", join(join([element("dt", key), element("dd", text)]) for key, text in told.items()))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Html:
    """Return a table; where the page is narrow its rows are blocks, and each cell says what it is."""
    head = element("tr", join(element("th", name) for name in header))

    def row(cells: Sequence[str]) -> Html:
        told = [element("td", cell, data_is=name) for name, cell in zip(header, cells, strict=True)]
        return element("tr", join(told))

    return element("table", element("thead", head), element("tbody", join(map(row, rows))))


def picture(figure: Figure, what: str, caption: str = "") -> Html:
    """Return a figure as a picture within the page; ``what`` says it to those who cannot see it."""
    with io.BytesIO() as memory:
        figure.savefig(memory, format="png", dpi=DPI)
        data = base64.b64encode(memory.getvalue()).decode("ascii")
    below = [element("figcaption", caption)] if caption else []
    return element("figure", element("img", src=f"data:image/png;base64,{data}", alt=what), *below)


def section(title: str, *content: str, level: int = 2) -> Html:
    """Return a section under a heading."""
    return element("section", element(f"h{level}", title), join(content))


def page(title: str, content: Iterable[str]) -> str:
    """Return a whole page."""
    head = join(
        [
            element("meta", charset="utf-8"),
            element("meta", name="viewport", content="width=device-width, initial-scale=1"),
            element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
            element("title", title),
            element("style", Html(_STYLE)),
        ]
    )
    whole = element("html", element("head", head), element("body", join(content)), lang="en")
    return f"<!doctype html>\n{whole}\n"


def _part(text: str) -> str:
    return text if isinstance(text, Html) else _text(text)


def _text(text: str) -> str:
    return escape(printable(text), quote=True)
