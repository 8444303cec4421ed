"""Whether the rig's calibrations are there, valid, and of its devices."""

from collections.abc import Iterator

from rig.errors import DataFileError
from rig.model.calibrations.base import Calibration, utc_now
from rig.model.calibrations.kinds import KINDS
from rig.model.calibrations.store import CalibrationStore, doubts
from rig.model.config import RigConfig
from rig.setup.doctor.finding import Finding


def check(config: RigConfig) -> Iterator[Finding]:
    """Return the newest of each kind, and in one line those that were never measured."""
    what = f"calibrations in {config.calibration.folder.absolute()}"
    if not config.calibration.use:
        yield Finding(what, "ok", "not used: calibration.use is false")
        return
    store = CalibrationStore(config.calibration.folder)
    absent = []
    for kind in KINDS:
        try:
            stored = store.newest(kind, rig_name=config.name)
        except DataFileError as error:
            yield Finding(f"calibration {kind}", "missing", str(error), f"rig calibrate {kind}")
            continue
        if stored is None:
            absent.append(kind)
        else:
            yield _one(stored.calibration, config)
    if absent:
        yield Finding(
            what,
            "ok" if config.rehearsed else "warning",
            f"never measured: {', '.join(absent)}; the configuration's values are used",
            "" if config.rehearsed else "rig calibrate all --config FILE",
        )


def _one(calibration: Calibration, config: RigConfig) -> Finding:
    what = f"calibration {calibration.kind}"
    days = (utc_now() - calibration.created).total_seconds() / 86400
    found = f"{max(days, 0):.0f} days old, valid for {calibration.valid_days:g}"
    again = f"rig calibrate {calibration.kind} --config FILE"
    if calibration.simulated != config.rehearsed:
        made = "the simulated rig" if calibration.simulated else "a real rig"
        return Finding(what, "warning", f"{found}, of {made}: it is not used", again)
    if others := _others(calibration, config):
        return Finding(what, "warning", f"{found}, of another device ({others}): it is not used", again)
    if doubt := doubts(calibration):
        return Finding(what, "warning", doubt, again)
    return Finding(what, "ok", found)


def _others(calibration: Calibration, config: RigConfig) -> str:
    """Return the devices of a calibration that are not those whose serial number the configuration says.

    What is connected says who it is only when a scan opens it.
    """
    serials = {role: getattr(getattr(config, role, None), "serial", None) for role in calibration.devices}
    return ", ".join(
        identity
        for role, identity in calibration.devices.items()
        if (serial := serials[role]) and serial not in identity
    )
