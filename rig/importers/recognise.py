"""Telling a file's layout by its content, and saying of an unknown file what it looks most like."""

from collections.abc import Sequence
from types import ModuleType

from rig.errors import DataFileError
from rig.importers.source import Source

#: So many arrays of an unknown file are named.
_NAMED = 12
#: So many layouts are named that it looks like.
_ALIKE = 2


def recognise(source: Source, layouts: Sequence[ModuleType]) -> ModuleType:
    """Return the only layout that a file has.

    Parameters
    ----------
    source
        The file.
    layouts
        Modules with NAME, PARTS and recognise(source).

    Raises
    ------
    DataFileError
        If it has none, or several.
    """
    found = [layout for layout in layouts if layout.recognise(source)]
    if len(found) == 1:
        return found[0]
    if found:
        names = " and as ".join(layout.NAME for layout in found)
        raise DataFileError(
            f"{source.path} can be read as {names}; it holds {source.contents(_NAMED)}. "
            "Keep the arrays of one layout"
        )
    own = source.hdf5 is not None and str(source.attribute("format", ""))
    if own and own.startswith("rig-"):
        what = "needs no import: rig recon reads it" if own == "rig-scan" else "holds no transients to import"
        raise DataFileError(f"{source.path} is a {own} file of this program, and {what}")
    alike = _alike(source, layouts)
    told = [_but_lacks(source, layout) for layout in alike[:_ALIKE]]
    if told:
        looks, more = f"looks most like {told[0]}", f" Next, it looks like {told[1]}." if told[1:] else ""
    else:
        known = "; ".join(f"{layout.PARTS[0]} ({layout.NAME})" for layout in layouts)
        looks, more = "has no layout that this program knows", f" Layouts are recognised by {known}."
    raise DataFileError(
        f"{source.path} {looks}: it has no known layout; it holds {source.contents(_NAMED)}.{more} "
        "What each layout needs: docs/importing.md"
    )


def _alike(source: Source, layouts: Sequence[ModuleType]) -> list[ModuleType]:
    """Return the layouts of which a file has parts, those of which it has most first, then lacks least."""

    def score(layout: ModuleType) -> tuple[float, int]:
        lacking = [part for part in layout.PARTS if not source.holds(part)]
        almost = sum(bool(_spelt_otherwise(source, part)) for part in lacking)
        return len(layout.PARTS) - len(lacking) + 0.5 * almost, -len(lacking)

    return sorted((one for one in layouts if score(one)[0]), key=score, reverse=True)


def _but_lacks(source: Source, layout: ModuleType) -> str:
    """Return the layout's name, and what a file lacks for it."""
    lacking = [part for part in layout.PARTS if not source.holds(part)]
    if not lacking:
        return f"{layout.NAME}, but is not {layout.SIGN}"
    others = [_spelt_otherwise(source, part) for part in lacking]
    said = [
        f"{part} (it has {other})" if other else part for part, other in zip(lacking, others, strict=True)
    ]
    return f"{layout.NAME}, but lacks {', '.join(said)}"


def _spelt_otherwise(source: Source, part: str) -> str:
    """Return the name in the file that differs from a part's in case and underscores alone; empty if none."""
    wanted = {_plain(name) for name in part.split(" or ")}
    return next((name for name in source.shapes if _plain(name) in wanted and not source.has(part)), "")


def _plain(name: str) -> str:
    return name.replace("_", "").lower()
