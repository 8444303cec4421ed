"""The reference pages that are made from the code: verbs, configuration, JSON documents, Python modules.

They are written into ``docs/reference/`` before Sphinx reads the pages, and belong to no commit.
"""

import importlib.util
from pathlib import Path
from typing import Any

import configuration
import documents
import verbs
from pages_made import write
from sphinx.application import Sphinx

#: Modules of the page about Python, by heading; one that is not there is left out.
MODULES = {
    "The program from Python": ["rig.api"],
    "Scan and volume files": ["rig.files.scan", "rig.files.volume", "rig.files.writer"],
    "Import": ["rig.importers.convert"],
    "Imaging": [
        "recon.capture",
        "recon.wave",
        "recon.grid",
        "recon.window",
        "recon.camera",
        "recon.imaging",
        "recon.result",
        "recon.registry",
        "recon.video",
        "recon.solvers.classic.solve",
    ],
    "From a volume to a surface": ["recon.depth", "recon.surface", "recon.noise"],
    "Measures": [
        "recon.measures.quality",
        "recon.measures.resolution",
        "recon.measures.surface",
        "recon.measures.widths",
    ],
    "Errors": ["rig.errors", "recon.errors", "drivers.errors"],
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Add to Sphinx what these pages need."""
    app.connect("builder-inited", _write_all)
    app.connect("autodoc-process-docstring", _escape_bars)
    app.connect("autodoc-skip-member", _skip_constants)
    return {"parallel_read_safe": True}


def _write_all(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "reference"
    write(folder / "commands.md", verbs.page())
    write(folder / "configuration.md", configuration.page())
    write(folder / "json.md", documents.page())
    write(folder / "python.md", python_page())
    documents.write_schemas(folder / "schemas")


def _skip_constants(app: Sphinx, what: str, name: str, member: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what is neither a class nor a function: numbers of a module are its own affair."""
    return True if what == "module" and not callable(member) else None


def _escape_bars(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Let docstrings have the magnitude |U| of a field, which reStructuredText takes for something else."""
    for number, line in enumerate(lines):
        parts = line.split("``")
        parts[::2] = [part.replace("|", "\\|") for part in parts[::2]]
        lines[number] = "``".join(parts)


def python_page() -> str:
    """Return the page of the modules that are for use from Python."""
    parts = [
        "# From Python\n",
        "Lengths are metres and times seconds; the unit is in each name. Arrays have their shape in the "
        "description.\n",
    ]
    for heading, modules in MODULES.items():
        there = [name for name in modules if _is_there(name)]
        if there:
            parts.append(f"## {heading}\n")
        for name in there:
            parts += [f"### {name}\n", f"```{{eval-rst}}\n.. automodule:: {name}\n   :members:\n```\n"]
    return "\n".join(parts)


def _is_there(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
