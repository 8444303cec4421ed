"""All checks of a rig, and what comes of them in a line."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rig.errors import reason
from rig.model.config import RigConfig
from rig.setup.doctor import (
    calibrations,
    cameras,
    clock,
    devices,
    disk,
    extras,
    light,
    permissions,
    software,
    terminal,
    timing,
)
from rig.setup.doctor.finding import Finding


@dataclass(frozen=True)
class Examination:
    """What all checks found.

    Attributes
    ----------
    rig
        Its kind, and its name.
    findings
        By the name of the check.
    """

    rig: str
    findings: dict[str, list[Finding]]

    def __len__(self) -> int:
        return sum(map(len, self.findings.values()))

    def count(self, verdict: str) -> int:
        """Return how often checks came to this."""
        return sum(one.verdict == verdict for found in self.findings.values() for one in found)

    @property
    def headline(self) -> str:
        """The rig, and how much is missing, for people."""
        missing, warnings = self.count("missing"), self.count("warning")
        said = (
            f"{missing} thing{'s are' if missing != 1 else ' is'} missing"
            if missing
            else "nothing is missing"
        )
        more = f", {warnings} warning{'s' if warnings != 1 else ''}" if warnings else ""
        return f"{self.rig}: {said}{more}"


def examine(config: RigConfig, folder: Path) -> Examination:
    """Run all checks for the rig that a configuration names; simulated rigs need no hardware.

    Parameters
    ----------
    config
        The rig.
    folder
        Where scans shall go. A small file is written there for a moment.
    """
    checks: dict[str, Callable[[], Iterable[Finding]]] = {
        "software": software.check,
        "extras": partial(extras.check, config),
        "devices": partial(devices.check, config),
        "timing": partial(timing.check, config),
        "cameras": partial(cameras.check, config),
        "permissions": partial(permissions.check, config),
        "light": partial(light.check, config),
        "calibrations": partial(calibrations.check, config),
        "disk": partial(disk.check, folder),
        "clock": clock.check,
        "terminal": terminal.check,
    }
    return Examination(_named(config), {name: _found(name, check) for name, check in checks.items()})


def _found(name: str, check: Callable[[], Iterable[Finding]]) -> list[Finding]:
    """Return what a check finds; what the system refuses to show is found, too."""
    try:
        return list(check())
    except OSError as problem:
        return [Finding(name, "missing", f"cannot be looked at: {reason(problem)}", "Work in another folder")]


def _named(config: RigConfig) -> str:
    kind = "Simulated rig" if config.simulated else "Served rig" if config.served else "Real rig"
    return kind if config.name.lower() == kind.lower() else f"{kind} {config.name}"
