"""What ``rig scan`` and ``rig resume`` share: progress, Ctrl-C, and the result."""

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.acquire.acquisition import ScanResult, Watch
from rig.acquire.events import Outcome
from rig.acquire.interrupt import StopRequest
from rig.commands import console
from rig.commands.notify import announce, failed
from rig.errors import DataFileError, InterruptedScanError, UsageError, in_shell
from rig.files.description import ScanDescription
from rig.files.journal import journal_of
from rig.files.outline import ScanOutline
from rig.files.scan import ScanFile
from rig.model.config import NotifyConfig
from rig.model.plan import ScanPlan
from rig.model.quantities import show, show_bytes, show_duration

if TYPE_CHECKING:
    from rig.image.until import Until
    from rig.live.feed import LiveFeed
    from rig.live.web.address import Address

#: Where no configuration is here, or it names nobody.
NOBODY = NotifyConfig()

Acquisition = Callable[[Watch], ScanResult]


@dataclass(frozen=True)
class Onlookers:
    """Who takes part in a scan beside its file and the terminal.

    Attributes
    ----------
    until
        What may end it before its last position; that is no failure.
    live
        Whether it is shown while it runs.
    fresh_to_m, video
        How frames are shown then (`rig.live.messages.Film`).
    web
        Where a page shows it; None for nowhere.
    notify
        Who gets a message at the end; of the configuration that is here, never of a file.
    """

    until: "Until | None" = None
    live: bool = False
    fresh_to_m: float | None = None
    video: Path | None = None
    web: "Address | None" = None
    notify: NotifyConfig = NOBODY


def page_at(given: str | None) -> "Address | None":
    """Return where a page is served, by the option ``--web``."""
    if given is None:
        return None
    from rig.live.web.address import address

    return address(given)


def ending(rule: str, plan: ScanPlan, scan: Path | None = None) -> "Until":
    """Return what ends a scan by a rule; of a scan that is taken up again, with what it holds."""
    from rig.image.until import Rule, Until

    until = Until(Rule.from_text(rule, plan))
    if scan is not None:
        with ScanFile(scan) as held:
            until.take_up(held)
    return until


def run(
    acquisition: Acquisition,
    plan: ScanPlan,
    target: Path,
    as_json: bool,
    config: Path | None = None,
    others: Onlookers = Onlookers(),
) -> None:
    """Run a scan into ``target`` and tell how it went.

    Parameters
    ----------
    acquisition
        Runs it.
    plan, target
        What is measured, and the scan file.
    as_json
        Whether the result is printed as a document.
    config
        The rig's configuration, if it takes one to go on with the scan.
    others
        Who takes part.

    Raises
    ------
    rig.errors.InterruptedScanError
        If the person stopped it after a position.
    """
    began_s, until = time.monotonic(), others.until
    progress = console.ScanProgress(len(plan))
    here = _is_there(target)  # before: a refusal leaves it as it was
    try:
        with ExitStack() as stack:
            stop = stack.enter_context(StopRequest(console.announce))
            feed = _feed(target, others, stop, config) if others.live or others.web else None
            if feed is not None:
                stack.callback(feed.close)
            lookers = [one for one in (until, feed) if one is not None]
            result = acquisition(_watch(progress, stop, lookers, until))
    except UsageError:  # nothing was begun, or gone on with
        raise
    except Exception as error:
        if here or _is_there(target):
            kept = _safe(target, config)
        elif progress.began:  # it was moved or deleted meanwhile, and the failure says where its data is
            kept = f"{target} is no longer there. What was measured is where the next message says."
        else:
            kept = "Nothing was measured, and no scan file was made."
        console.announce(kept)
        announce(others.notify, failed(error, file=str(target), photons=_photons(target), kept=kept))
        raise
    summary = _summary(result, target, time.monotonic() - began_s)
    _show(result, plan, summary, as_json)
    announce(others.notify, summary)
    if until and until.trouble:
        console.warn(until.trouble)
    if until and result.ended.outcome is Outcome.INTERRUPTED and result.ended.reason == until.reason():
        console.say(f"Ended as asked: {until.reason()}. {_safe(target, config)}")
        return
    if plan.endless and result.ended.outcome is Outcome.INTERRUPTED:
        console.say(f"Ended as asked: {result.ended.reason}. {_safe(target, config)}")
        return
    if result.ended.outcome is not Outcome.COMPLETE:
        raise InterruptedScanError(f"{target}: the scan was stopped. {_safe(target, config)}")


def _watch(
    progress: console.ScanProgress,
    stop: StopRequest,
    lookers: "Sequence[Until | LiveFeed]",
    until: "Until | None",
) -> Watch:
    def begun(description: ScanDescription) -> None:
        for one in lookers:
            one.begun(description)

    return Watch([progress, *lookers], lambda: stop() or (until.reason() if until else False), begun)


def _feed(target: Path, others: Onlookers, stop: StopRequest, config: Path | None) -> "LiveFeed":
    from rig.live.feed import LiveFeed, Page
    from rig.live.messages import Film, Next

    video = others.video.absolute() if others.video else None
    feed = LiveFeed(
        target,
        console.warn,
        inform=console.say,
        window=others.live and console.err.is_terminal,
        film=Film(others.fresh_to_m, video),
        page=Page(others.web, stop.ask, Next(_go_on(target, config), _image(target))) if others.web else None,
    )
    console.say(f"Live pictures: {feed.folder / 'now.png'}")
    return feed


def _is_there(target: Path) -> bool:
    """Return whether there is anything of a scan, a journal without its file among it."""
    return os.path.exists(target) or os.path.exists(journal_of(target))


def _safe(target: Path, config: Path | None) -> str:
    """Say how much of a scan that ended early can be read back from its file, and how to go on."""
    again = _go_on(target, config)
    try:
        with ScanFile(target) as scan:
            measured, steps = int(np.count_nonzero(scan.done)), scan.steps
    except DataFileError as error:
        return f"The measured data cannot be read back now: {error}"
    return (
        f"{measured:,} of {steps:,} positions are safe in the file and can be imaged. Continue with: {again}"
        if measured
        else f"No position was measured yet: {target} is safe and empty. Continue with: {again}"
    )


def _go_on(target: Path, config: Path | None) -> str:
    """Return the command that takes a scan up again."""
    return in_shell("rig", "resume", target, *(("--config", config) if config else ()))


def _image(target: Path) -> str:
    """Return the command that images a scan."""
    return in_shell("rig", "recon", target)


def _light(result: ScanResult) -> dict[str, object] | None:
    """Return what was last known of the light; None where no laser was opened."""
    light = result.light
    return None if light is None else {"emitting": light.on, "read_back": light.when}


def _photons(target: Path) -> int | None:
    """Return the photons of a scan that failed; None where its file cannot be read, or is none."""
    with suppress(DataFileError), ScanOutline(target) as scan:
        return scan.photons
    return None


def _whole(target: Path, result: ScanResult) -> tuple[int, float]:
    """Return photons and measurement time of a scan as a whole, what was there before it was resumed too."""
    try:
        with ScanOutline(target) as scan:
            return scan.photons, float(np.nansum(scan.live_time_s))
    except DataFileError:  # it was read back when it was closed: the scan does not fail for a summary
        return result.photons, result.live_time_s


def _summary(result: ScanResult, target: Path, took_s: float) -> dict[str, Any]:
    """Return how a scan ended, as the document that ``--json`` prints and a message holds."""
    photons, live_time_s = _whole(target, result)
    status, measured = result.ended.outcome.value, result.ended.steps_done
    counted = f"{measured:,} positions, {photons:,} photons"
    return {
        "file": str(target),
        "status": status,
        "reason": result.ended.reason,
        "positions": measured,
        "photons": photons,
        "live_time_s": live_time_s,
        "photons_now": result.photons,
        "took_s": round(took_s, 2),
        "laser": _light(result),
        "unverified": list(result.unverified),
        "sentence": f"{target}: {status} ({result.ended.reason}), {counted}",
    }


def _show(result: ScanResult, plan: ScanPlan, summary: dict[str, Any], as_json: bool) -> None:
    if as_json:
        console.print_json(summary)
        return
    target, photons, live_time_s = Path(summary["file"]), summary["photons"], summary["live_time_s"]
    rate_hz = photons / live_time_s if live_time_s else 0.0
    now = {"of these": f"{result.photons:,} now, the others before"} if result.photons != photons else {}
    measured, frames = result.ended.steps_done, plan.frames
    whole, planned = measured * frames // len(plan), "" if plan.endless else f" of {len(plan):,}"
    console.print_facts(
        str(target),
        {
            "positions": f"{measured:,}{planned}",
            **({"frames": f"{whole:,}" if plan.endless else f"{whole} of {frames}"} if frames > 1 else {}),
            "photons": f"{photons:,} ({show(rate_hz, 'photons/s')})",
            **now,
            "size": show_bytes(target.stat().st_size),
            "took": show_duration(summary["took_s"]),
        },
    )
    if result.ended.outcome is Outcome.COMPLETE:
        console.say(f"Next: {_image(target)}")
