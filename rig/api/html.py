"""How things look in a notebook."""

import base64
import io
from collections.abc import Mapping
from html import escape

from matplotlib.figure import Figure


def table(title: str, facts: Mapping[str, str], warnings: tuple[str, ...] = ()) -> str:
    """Return facts as a table with a title; warnings stand above them."""
    rows = [("warning", one) for one in warnings] + list(facts.items())
    lines = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td style='text-align:left'>{escape(text)}</td>"
        "</tr>"
        for name, text in rows
    )
    return f"<table><caption style='text-align:left'>{escape(title)}</caption>{lines}</table>"


def picture(figure: Figure, what: str) -> str:
    """Return a figure as an image within the page; ``what`` it shows is said to those who cannot see it."""
    file = io.BytesIO()
    figure.savefig(file, format="png")
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return f"<img alt='{escape(what, quote=True)}' style='max-width:100%' src='data:image/png;base64,{data}'>"


def lines(title: str, facts: Mapping[str, str], warnings: tuple[str, ...] = ()) -> str:
    """Return the same as text, for a terminal."""
    rows = [("warning", one) for one in warnings] + list(facts.items())
    return "\n".join([title, *(f"  {name:<12} {text}" for name, text in rows)])
