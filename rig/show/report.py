"""A scan and its image on one page: what was measured, with what, how it went, and how to do it again."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

import rig
from rig.atomic import appearing, refusals_told
from rig.errors import DataFileError, in_shell
from rig.files.check import reading
from rig.files.scan import ScanFile
from rig.model.calibrations.base import Calibration, utc_now
from rig.model.quantities import show, show_duration, show_length
from rig.model.written import as_toml
from rig.show.about import About, about, at, calibration_document, calibration_in_words, with_units
from rig.show.page import Html, element, facts, join, page, picture, section, table
from rig.show.raw import scan_figure
from rig.show.saving import DPI
from rig.show.volume import WIDTH_PX
from rig.show.wall import counts_of_spots, draw_counts

#: Points of the curve of rates, means over as many steps as it takes.
_POINTS = 600
#: Rows of the table of events; a scan of a bad night has thousands.
_EVENTS = 200
#: Facts that stand in sections of their own.
_ELSEWHERE = ("warnings", "source", "sha256", "plan")


@dataclass(frozen=True)
class Imaged:
    """The image of a scan, for its report.

    Attributes
    ----------
    path
        The volume file.
    figure
        Its picture.
    """

    path: Path
    figure: Figure


def save_report(path: Path, scan: ScanFile, image: Imaged | None = None) -> list[str]:
    """Write a page about a scan; it appears whole or not at all.

    Parameters
    ----------
    path
        The page.
    scan
        What is told.
    image
        What was imaged of it, if anything.

    Returns
    -------
    What a person must know, as sentences.

    Raises
    ------
    DataFileError
        If a file is damaged, or the page cannot be written.
    """
    found = about(image.path) if image else None
    with reading(scan.path):
        doubts = [*scan.doubts, *_of_another(scan, found)]
        parts = [*_head(scan, doubts), *_image(path, image, found), *_measured(scan), *_settings(scan)]
        text = page(f"{scan.path.name}: report", [*parts, *_again(scan, found)])
    with refusals_told(path), appearing(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return doubts


def _of_another(scan: ScanFile, found: About | None) -> list[str]:
    """Say if an image was not made of this scan as it is now."""
    if found is None or found.document["scan_sha256"] == scan.digest:
        return []
    return [
        f"{found.document['file']} was not made from the present {scan.path}, but from "
        f"{found.document['scan'] or 'a scan that it does not name'}: image it again with "
        f"{in_shell('rig', 'recon', scan.path)}"
    ]


def _head(scan: ScanFile, doubts: Sequence[str]) -> Iterator[Html]:
    """Say what it is, how it ended, and what went less than well."""
    summary = scan.summary()
    yield element("h1", scan.path.name)
    origin = " · ".join(filter(None, [scan.config.name if scan.config else "", _date(scan.created)]))
    badge = element("span", scan.status, class_=f"badge {scan.status}")
    yield element(
        "p", badge, f" {origin}" + (" · simulated photons" if scan.simulated else ""), class_="lead"
    )
    if told := [*doubts, *scan.warnings]:
        yield element("ul", join(element("li", one) for one in told), class_="warnings")
    if scan.notes:
        yield section("Notes", facts(scan.notes))
    summary["created"] = _date(summary.get("created", ""))
    kept = {name: text for name, text in summary.items() if text and name not in (*_ELSEWHERE, *scan.notes)}
    yield section("The scan", facts(kept), *_plan(scan))


def _plan(scan: ScanFile) -> Iterator[Html]:
    if scan.plan is None:
        return
    total = f"{show_duration(scan.plan.exposure_total_s)} of exposure planned"
    rows = [
        (
            one.name or str(number),
            f"{len(one):,}",
            f"{one.positions.columns} x {one.positions.rows}, {show_length(one.positions.spacing_m)} apart, "
            f"{one.positions.order}"
            if one.positions.kind == "grid"
            else "a list of spots",
            show(one.exposure_s, "s"),
            one.motion,
            str(one.frames),
        )
        for number, one in enumerate(scan.plan.passes, 1)
    ]
    yield section(
        "Plan",
        element("p", f"{scan.plan.in_words()}; {total}."),
        table(("pass", "steps", "positions", "exposure", "mirror", "frames"), rows),
        level=3,
    )


def _image(page_path: Path, image: Imaged | None, found: About | None) -> Iterator[Html]:
    """Show the image, and how it was made."""
    if image is None or found is None:
        return
    told = {name: text for name, text in found.facts.items() if name not in ("sha256", "made by")}
    parts = [picture(image.figure, "the image of the hidden scene"), facts(told)]
    turned = image.path.with_suffix(".html")  # a page that shows it in three dimensions, if somebody made one
    if turned.is_file() and turned != page_path:
        name = turned.name if turned.parent == page_path.parent else turned.absolute().as_uri()
        parts.append(element("p", element("a", f"Turn it in three dimensions: {turned.name}", href=name)))
    yield section("The image", *parts)


def _measured(scan: ScanFile) -> Iterator[Html]:
    """Show what was counted: over the wall, over time, and as histograms."""
    photons = scan.photons_of_steps()
    done = np.isfinite(photons)
    if not done.any():
        yield section("Counts", element("p", "No position was measured."))
        return
    spots_m, counted = counts_of_spots(scan.laser_m, photons)
    parts = [
        picture(
            _wall_figure(spots_m, counted),
            "photons counted at each laser spot on the wall",
            f"From {counted.min():,.0f} to {counted.max():,.0f} at a spot, {np.median(counted):,.0f} in the "
            "median. Light grey: not measured.",
        )
    ]
    live_s = scan.live_time_s.astype(float)
    timed = done & (live_s > 0)
    if timed.sum() > 1 and not scan.expectation:
        rates = _rate_figure(photons[timed], live_s[timed])
        parts.append(picture(rates, "photons a second of exposure, in the order of measurement"))
    try:
        histograms = scan_figure("histograms", scan.capture())
        parts.append(picture(histograms, "all counts over time, and the histograms of three positions"))
    except DataFileError as error:  # passes with settings of their own, or a record that ends early
        parts.append(element("p", f"No histograms are drawn: {error}."))
    yield section("Counts", *parts)


def _settings(scan: ScanFile) -> Iterator[Html]:
    """Tell devices, calibrations, and what happened."""
    if scan.devices:
        cards = [section(name, facts(with_units(said)), level=3) for name, said in scan.devices.items()]
        yield section("Settings, read back from the devices", element("div", join(cards), class_="cards"))
    used: Sequence[Calibration] = list(scan.calibrations.records.values())
    if used:
        told = [calibration_document(one, at(scan)) for one in used]
        rows = [(one["kind"], calibration_in_words(one), _date(one["created"])) for one in told]
        yield section("Calibrations", table(("kind", "found, and its age at the scan", "of"), rows))
    elif scan.config:
        yield section("Calibrations", element("p", "None: the values of the configuration are used."))
    if scan.events:
        happened = [
            (_date(one.utc), f"{one.first:,}" + (f" to {one.last:,}" if one.last > one.first else ""),
             one.kind, one.sentence)
            for one in scan.events[:_EVENTS]
        ]  # fmt: skip
        more = len(scan.events) - len(happened)
        rest = [element("p", f"And {more:,} more; the log next to the scan file has all.")] if more else []
        yield section("Events", table(("when", "positions", "kind", "what"), happened), *rest)


def _again(scan: ScanFile, found: About | None) -> Iterator[Html]:
    """Tell how to do it again, and of which bytes this page speaks."""
    commands = [scan.command, found.document["command"] if found else ""]
    commands.append(in_shell("rig", "report", scan.path, *([found.document["file"]] if found else [])))
    parts = [element("pre", element("code", "\n".join(filter(None, commands))))]
    programs = {"scan made by": scan.software, "page made by": f"nlos-rig {rig.__version__}"}
    if found:
        programs["image made by"] = str(found.document["software"])
    parts.append(facts({name: text or "unknown" for name, text in programs.items()}))
    if scan.config:
        parts += [
            element("h3", "Configuration"),
            element("p", "The values that differ from the defaults, as a configuration file."),
            element("pre", element("code", as_toml(scan.config))),
        ]
    yield section("How to repeat it", *parts)
    digests = {scan.path.name: "the scan is still being written" if scan.growing else scan.digest}
    if found:
        digests[Path(found.document["file"]).name] = found.document["sha256"]
    written = f"Page of {utc_now():%Y-%m-%d %H:%M} UTC."
    yield section("SHA-256 of the files", facts(digests), element("p", written, class_="lead"))


def _wall_figure(spots_m: NDArray[np.float64], counted: NDArray[np.float64]) -> Figure:
    figure = Figure(figsize=(10.0, 6.5), dpi=DPI, facecolor="white", layout="compressed")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    figure.colorbar(draw_counts(axes, spots_m, counted), ax=axes, label="photons at a spot")
    axes.set_title("counts over the wall")
    return figure


def _rate_figure(photons: NDArray[np.float64], live_s: NDArray[np.float64]) -> Figure:
    """Draw photons a second of exposure over exposure time, as means over so many steps."""
    starts = np.unique(np.linspace(0, len(photons), min(_POINTS, len(photons)) + 1)[:-1].astype(int))
    summed, lived_s = np.add.reduceat(photons, starts), np.add.reduceat(live_s, starts)
    until_s = np.cumsum(lived_s)
    last_s = float(until_s[-1])
    unit, name = (1, "s") if last_s < 180 else (60, "min") if last_s < 10800 else (3600, "h")
    figure = Figure(figsize=(WIDTH_PX / DPI, 4.0), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot((until_s - lived_s / 2) / unit, summed / lived_s / 1e3, color="#20639b", linewidth=1)
    axes.set(
        title="rate in the order of measurement",
        xlabel=f"exposure so far ({name})",
        ylabel="thousand photons a second",
        xlim=(0, last_s / unit),
        ylim=(0, max(1.1 * float((summed / lived_s).max()) / 1e3, 1e-3)),
    )
    return figure


def _date(utc: str) -> str:
    """Write a date of ISO 8601 as people do."""
    return utc.replace("T", " ").replace("+00:00", " UTC")
