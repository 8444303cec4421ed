"""``rig calibrate show``: what the rig knows of itself, and whether it is still good."""

from datetime import datetime
from typing import TYPE_CHECKING

from rig.commands.options import AsJson, Config

if TYPE_CHECKING:
    from rig.model.calibrations.store import Stored


def show(
    config: Config = None,
    as_json: AsJson = False,
) -> None:
    """List the newest calibration of each kind: what it found, of which devices, and until when it holds.

    Whether they belong to the devices that are connected is seen when a scan begins.
    """
    from rig.commands import console
    from rig.model.calibrations.base import utc_now
    from rig.model.calibrations.kinds import KINDS
    from rig.model.calibrations.store import CalibrationStore
    from rig.model.config import built_in, load

    rig_config = load(config) if config else built_in()
    store = CalibrationStore(rig_config.calibration.folder)
    now = utc_now()
    newest = {kind: store.newest(kind, rig_name=rig_config.name) for kind in KINDS}
    if as_json:
        console.print_json(
            {
                "folder": str(store.folder),
                "calibrations": {
                    kind: _as_dict(stored, now) if stored else None for kind, stored in newest.items()
                },
            }
        )
        return
    facts = {}
    for kind, stored in newest.items():
        facts[kind] = _in_words(stored, now) if stored else f"never measured: rig calibrate {kind}"
    console.print_facts(f"{rig_config.name}: calibrations in {store.folder}", facts)


def _in_words(stored: "Stored", now: datetime) -> str:
    from rig.model.calibrations.headlines import headline

    calibration = stored.calibration
    verdict = f"valid until {calibration.expires:%Y-%m-%d}"
    if calibration.is_old(now):
        verdict = "OLD, measure again"
    elif calibration.is_from_the_future(now):
        verdict = "DATED IN THE FUTURE, set the clock or measure again"
    serials = ", ".join(f"{name} '{identity}'" for name, identity in calibration.devices.items())
    simulated = " (simulated)" if calibration.simulated else ""
    return (
        f"{headline(calibration)}\n"
        f"{calibration.created:%Y-%m-%d %H:%M} UTC{simulated}, {verdict}; {stored.path.name}\n"
        f"of {serials or 'no particular device'}"
    )


def _as_dict(stored: "Stored", now: datetime) -> dict:
    from rig.model.calibrations.headlines import headline

    calibration = stored.calibration
    return {
        "file": str(stored.path),
        "created": calibration.created,
        "expires": calibration.expires,
        "valid": not (calibration.is_old(now) or calibration.is_from_the_future(now)),
        "devices": calibration.devices,
        "software": calibration.software,
        "simulated": calibration.simulated,
        "found": headline(calibration),
    }
