"""Whether the laser's guard can begin its work, and whether a trip is open."""

import subprocess
from collections.abc import Iterator

from rig.errors import in_shell
from rig.model.config import RigConfig
from rig.setup.doctor.finding import Finding

#: Longest wait for a guard to begin, see that nobody speaks to it, and end.
PATIENCE_S = 30.0


def check(config: RigConfig) -> Iterator[Finding]:
    """Return what is known of the guard; a simulated laser has it in the same process."""
    if config.simulated:
        return
    from rig.light.state import trip_of

    yield _guard()
    if trip := trip_of(config):
        yield Finding(
            "trip",
            "missing",
            f"the light was lost at {trip.when} ({trip.reason}), and no person has acknowledged it",
            f"Check the rig, and then: {in_shell('rig', 'laser', 'acknowledge')} --config FILE",
        )


def _guard() -> Finding:
    """Start a guard that is given no laser; it ends by itself."""
    from rig.light.remote import start_guard

    remedy = "Free memory, and check whether this Python may start other processes"
    try:
        with start_guard() as guard:
            try:
                guard.communicate("", timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                guard.kill()
                return Finding("guard", "missing", f"did not end within {PATIENCE_S:g} s", remedy)
    except OSError as problem:
        return Finding("guard", "missing", f"cannot start: {problem.strerror}", remedy)
    if guard.returncode:
        return Finding("guard", "missing", f"ended with {guard.returncode}", remedy)
    return Finding("guard", "ok", "can start; it controls the laser in a separate process")
