"""What a file is, told in short: for people as labelled lines, for programs as one document."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import DataFileError, in_shell, no_file, printable
from rig.files.check import open_hdf5, plain, reading
from rig.files.journal import has_journal
from rig.files.outline import ScanOutline
from rig.files.picoquant import MAGIC_HISTOGRAMS, STEPS, Head
from rig.files.recorded import digest_of_file
from rig.files.scan import ScanFile
from rig.files.volume import outline_volume
from rig.model.calibrations.base import Calibration, utc_now
from rig.model.calibrations.headlines import headline
from rig.model.calibrations.store import read as read_calibration
from rig.model.config import load
from rig.model.plan import Grid, ScanPlan
from rig.model.quantities import show, show_bytes, show_length
from rig.whole import read_whole

#: How numbers are written whose names end in their unit.
_UNITS: Mapping[str, Callable[[float], str]] = {
    "m": show_length,
    "rad": lambda angle_rad: f"{math.degrees(angle_rad):.4g} deg",
    "c": lambda degrees: f"{degrees:.4g} °C",
    **{symbol.lower(): partial(show, unit=symbol, digits=5) for symbol in ("s", "Hz", "V", "W")},
}
#: So many names of a file of another program are told.
_NAMED = 12


@dataclass(frozen=True)
class About:
    """What a file is.

    Attributes
    ----------
    facts
        For people, by label.
    document
        For programs: what JSON can hold; ``kind`` is ``scan``, ``volume``, ``calibration``,
        ``configuration``, ``records``, or ``foreign``.
    """

    facts: dict[str, str]
    document: dict[str, Any]


def about(path: Path) -> About:
    """Tell what a file is, by its content.

    Raises
    ------
    DataFileError
        If it is missing, damaged, or nothing that this program or its importers know.
    ConfigError
        If it is a configuration with mistakes.
    """
    if path.is_dir():
        raise DataFileError(f"{path} is a folder: {in_shell('rig', 'list', path)} lists its scans")
    if path.name.endswith(".h5.journal"):
        path = path.with_name(path.name.removesuffix(".journal"))
    if path.suffix.lower() == ".toml":
        return _configuration(path)
    if has_journal(path):
        return _scan(path)
    if not path.is_file():
        raise DataFileError(no_file(path))
    if h5py.is_hdf5(path):
        return _hdf5(path)
    with path.open("rb") as file:
        first = file.read(1)
    return _calibration(path) if first == b"{" else _foreign(path)


def scan_document(scan: ScanOutline) -> dict[str, Any]:
    """Return what a scan file says beside its photons, for programs."""
    config, plan = scan.config, scan.plan
    live_s = scan.live_time_s
    return {
        "kind": "scan",
        "file": str(scan.path),
        "created": scan.created or None,
        "software": scan.software or None,
        "command": scan.command or None,
        "rig": config.name if config else None,
        "simulated": scan.simulated,
        "status": scan.status,
        "reason": scan.reason or None,
        "plan": plan_document(plan) if plan else None,
        "positions": scan.steps,
        "measured": int(np.count_nonzero(scan.marked)),
        "frames": scan.frames,
        "live_time_s": float(np.nansum(live_s)),
        "photons": scan.photons if scan.closed and not scan.expectation else None,
        "warnings": scan.warnings,
        "calibrations": [calibration_document(one, at(scan)) for one in scan.calibrations.records.values()],
        "notes": scan.notes,
        "imported": scan.imported or None,
    }


def plan_document(plan: ScanPlan) -> list[dict[str, Any]]:
    """Return the passes of a plan, without the places of a list of spots."""
    return [
        {
            "name": one.name,
            "positions": len(one.positions.spots_m),
            **(one.positions.model_dump(mode="json") if isinstance(one.positions, Grid) else {}),
            "exposure_s": one.exposure_s,
            "frames": one.frames,
            "motion": one.motion,
        }
        for one in plan.passes
    ]


def calibration_document(found: Calibration, then: datetime) -> dict[str, Any]:
    """Return what a calibration is, and how old it is, or was then."""
    return {
        "kind": found.kind,
        "found": headline(found),
        "created": found.created.isoformat(),
        "expires": found.expires.isoformat(),
        "age_days": round((then - found.created).total_seconds() / 86400, 2),
        "was_good": not found.is_old(then) and not found.is_from_the_future(then),
        "rig": found.rig_name,
        "simulated": found.simulated,
    }


def calibration_in_words(document: dict[str, Any]) -> str:
    """Return a calibration's document as a line."""
    age = age_in_words(timedelta(days=document["age_days"]))
    return f"{document['found']}; {age} old" + ("" if document["was_good"] else ", NO LONGER VALID")


def age_in_words(age: timedelta) -> str:
    """Return an age as a person says it."""
    minutes = age.total_seconds() / 60
    for unit, size in (("day", 1440), ("hour", 60), ("minute", 1)):
        if minutes >= size or unit == "minute":
            number = int(minutes // size)
            return f"{number} {unit}{'' if number == 1 else 's'}"
    raise AssertionError("unreachable")


def at(scan: ScanOutline) -> datetime:
    """Return when a scan was made, or the present time where its file does not say."""
    try:
        made = datetime.fromisoformat(scan.created)
    except ValueError:
        return utc_now()
    return made if made.tzinfo else made.replace(tzinfo=utc_now().tzinfo)


def _scan(path: Path) -> About:
    with ScanFile(path) as scan, reading(path):
        document = scan_document(scan)
        facts = scan.summary()
        for one in document["calibrations"]:
            facts[one["kind"].replace("_", " ")] = calibration_in_words(one)
        # what is not complete is digested, too; what grows is another file in a second
        digest = None if scan.growing else scan.digest
        document |= {
            "photons": None if scan.expectation else int(scan.count()),
            "measured": int(np.count_nonzero(scan.done)),
            "doubts": scan.doubts,
            "sha256": digest,
        }
    return About(facts | ({"sha256": digest} if digest else {}), document)


def _hdf5(path: Path) -> About:
    with open_hdf5(path) as file, reading(path):
        name = plain(file.attrs.get("format"))
        root = {key: str(plain(file.attrs.get(key, ""))) for key in ("created", "software")}
    if name == "rig-scan":
        return _scan(path)
    if name == "rig-volume":
        return _volume(path)
    if name == "rig-wall-images":
        digest = digest_of_file(path)
        facts = {"what": "camera pictures of a calibration", **root, "sha256": digest}
        return About(facts, {"kind": "wall images", "file": str(path), **root, "sha256": digest})
    return _foreign(path)


def _volume(path: Path) -> About:
    found, digest = outline_volume(path), digest_of_file(path)
    parameters = dict(found.parameters)
    sides = [
        f"{name} {show_length(low)} to {show_length(high)}"
        for name, (low, high) in zip("xyz", (found.x_m, found.y_m, found.z_m), strict=True)
    ]
    facts = {
        "what": "video of a hidden scene" if found.t_s is not None else "image of a hidden scene",
        "of scan": _where_scan_is(path, found.scan, found.scan_digest),
        "voxels": f"{found.voxels[0]} x {found.voxels[1]} x {found.voxels[2]}: {', '.join(sides)}",
    }
    if found.t_s is not None:
        first, last = show(float(found.t_s[0]), "s"), show(float(found.t_s[-1]), "s")
        facts["frames"] = f"{len(found.t_s)}, {first} to {last}"
    facts |= with_units({name: value for name, value in parameters.items() if value is not None})
    if found.command:
        facts["made by"] = found.command
    facts["created"] = f"{found.created} by {found.software or 'an unnamed program'}"
    document = {
        "kind": "volume",
        "file": str(path),
        "created": found.created,
        "software": found.software,
        "scan": found.scan,
        "scan_sha256": found.scan_digest,
        "voxels": found.voxels,
        "x_m": found.x_m,
        "y_m": found.y_m,
        "z_m": found.z_m,
        "frames": None if found.t_s is None else len(found.t_s),
        "parameters": parameters,
        "command": found.command or None,
        "sha256": digest,
    }
    return About(facts | {"sha256": digest}, document)


def with_units(values: Mapping[str, Any]) -> dict[str, str]:
    """Return values by label, in words; a name such as ``bin_width_s`` gives its unit to the value."""
    told = {}
    for name, value in values.items():
        stem, _, symbol = name.rpartition("_")
        numbers = value if isinstance(value, list) else [value]
        if stem and symbol in _UNITS and all(map(_is_number, numbers)):
            label, text = stem, "; ".join(map(_UNITS[symbol], numbers))
        else:
            label, text = name, "; ".join(map(_plainly, numbers))
        told[label.replace("_", " ")] = text
    return told


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plainly(value: Any) -> str:
    """Write a value: numbers without the digits that floating point adds, tables with the units of names."""
    if isinstance(value, Mapping):
        return ", ".join(f"{label} {text}" for label, text in with_units(value).items())
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _where_scan_is(path: Path, name: str, digest: str) -> str:
    """Say of which scan a volume is, and whether that lies beside it."""
    if not name:
        return "not in the file"
    beside = path.with_name(Path(name).name)
    if not beside.is_file():
        return f"{name}, which is not in the same folder"
    same = digest_of_file(beside) == digest
    return (
        f"{name}, in the same folder"
        if same
        else f"{name}; the file of this name in the same folder is another, or has changed since"
    )


def _calibration(path: Path) -> About:
    found = read_calibration(path)
    told = calibration_document(found, utc_now())
    facts = {
        "what": f"calibration '{found.kind}' of {found.rig_name}" + (" (simulated)" * found.simulated),
        "found": headline(found),
        "created": f"{found.created:%Y-%m-%d %H:%M} UTC, {age_in_words(utc_now() - found.created)} ago, by "
        f"{found.software}",
        "good until": f"{found.expires:%Y-%m-%d}" + ("" if told["was_good"] else ": no longer valid"),
        "of": ", ".join(f"{name} '{identity}'" for name, identity in found.devices.items())
        or "no particular device",
        "measured from": ", ".join(found.measured_from) or "no file",
        **({"warnings": "; ".join(found.warnings)} if found.warnings else {}),
    }
    content = json.loads(read_whole(path))
    document = {**told, "kind": "calibration", "calibration": found.kind, "file": str(path)}
    document |= {"devices": found.devices, "measured_from": found.measured_from, "warnings": found.warnings}
    return About(facts | {"digest": content["digest"]}, document | {"digest": content["digest"]})


def _configuration(path: Path) -> About:
    config = load(path)
    devices = {
        role: getattr(config, role).kind
        for role in ("galvo", "laser", "detector", "delayer", "tcspc", "point_clock", "shutter")
        if getattr(config, role) is not None
    }
    plan, digest = ScanPlan.grid(config), digest_of_file(path)
    facts = {
        "what": f"configuration of {config.name}, {'simulated' if config.simulated else 'a real rig'}",
        "devices": ", ".join(f"{role.replace('_', ' ')} {kind}" for role, kind in devices.items()),
        "channels": f"{len(config.channels)}",
        "scan": plan.in_words(),
        "calibrations": f"in {config.calibration.folder}" + ("" if config.calibration.use else ", not used"),
        **config.notes.said(),
        "sha256": digest,
    }
    document = {
        "kind": "configuration",
        "file": str(path),
        "rig": config.name,
        "simulated": config.simulated,
        "devices": devices,
        "channels": len(config.channels),
        "plan": plan_document(plan),
        "notes": config.notes.said(),
        "sha256": digest,
    }
    return About(facts, document)


def _foreign(path: Path) -> About:
    """Tell what the importers recognise a file as."""
    # what most files need not
    from rig.importers.convert import LAYOUTS
    from rig.importers.recognise import recognise
    from rig.importers.source import open_source

    with open_source(path) as source:
        layout, contents, head = recognise(source, LAYOUTS), source.contents(_NAMED), source.head
    size, digest = path.stat().st_size, digest_of_file(path)
    document = {"kind": "foreign", "file": str(path), "layout": layout.NAME, "bytes": size, "sha256": digest}
    facts = {"what": f"{layout.NAME}: {layout.SIGN}", "holds": contents, "size": show_bytes(size)}
    if head is not None and head.values.get("CreatorSW_Name") == "nlos-rig":
        facts, told = _records(path, head)
        document |= {"kind": "records", **told}
    else:
        facts |= {} if head is None else _instrument(head)
        facts["next"] = "rig import turns it into a scan file; docs/importing.md explains what may be missing"
    return About({**facts, "sha256": digest}, document)


def _instrument(head: Head) -> dict[str, str]:
    """Return what a head of PicoQuant's says of its curves or its records, in words."""
    if head.magic == MAGIC_HISTOGRAMS:
        width_s, bins = (head.numbers(f"HistResDscr_{name}") for name in ("MDescResolution", "HistogramBins"))
        of = f", the first of {int(bins[0]):,} bins of {show(width_s[0], 's', 4)}" if len(bins) else ""
        return {"holds": f"{int(head.number('HistoResult_NumberOfCurves')):,} histograms (curves){of}"}
    t3 = int(head.number("TTResultFormat_TTTRRecType")) >> 8 & 0xFF == 3  # 0x00010304 is a HydraHarp's T3
    width = show(head.number("MeasDesc_Resolution", 0), "s", 4)
    records = f"T3 records, bins of {width}" if t3 else "T2 records"
    return {"holds": f"{int(head.number('TTResult_NumberOfRecords', 0)):,} {records}"}


def _records(path: Path, head: Head) -> tuple[dict[str, str], dict[str, Any]]:
    """Tell of records that this program kept beside a scan."""
    scan = path.with_suffix(".h5")
    records, steps = int(head.number("TTResult_NumberOfRecords", 0)), head.number(STEPS, -1)
    sync_hz, width_s = head.number("TTResult_SyncRate", 0), head.number("MeasDesc_Resolution", 0)
    comment = printable(str(head.values.get("File_Comment", "")))
    facts = {
        "what": "the timing instrument's records of a scan, in PicoQuant's layout, kept by this program",
        "of scan": f"{scan}, in the same folder" if scan.is_file() else "not in the same folder",
        "records": f"{records:,}" if records else "the file was not closed: it is read up to its end",
        "bins": f"of {show(width_s, 's', 4)}",
        "sync": show(sync_hz, "Hz"),
        "comment": comment,
    }
    told = {
        "records": records,
        "positions": int(steps) if steps >= 0 else None,
        "sync_rate_hz": sync_hz,
        "bin_width_s": width_s,
        "comment": comment,
        "scan": str(scan) if scan.is_file() else None,
    }
    return facts, told
