"""A new configuration held against what a dry run asks."""

from pathlib import Path

from drivers.errors import LimitError
from rig.acquire.preflight import check, estimate
from rig.errors import RigError
from rig.model.config import RigConfig
from rig.model.plan import ScanPlan
from rig.model.state import RigState

#: Smallest grid that is offered.
_FEWEST = 10


def within_reach(config: RigConfig) -> RigConfig:
    """Return a rig whose grid is no larger than its mirror reaches, with as many positions as that leaves."""
    limits_rad = (config.galvo.max_angle_x_rad, config.galvo.max_angle_y_rad)
    while config.scan.columns > _FEWEST and config.scan.rows > _FEWEST:
        needed_rad = estimate(ScanPlan.grid(config), RigState(config)).mirror_rad
        if all(needed <= limit for needed, limit in zip(needed_rad, limits_rad, strict=True)):
            break
        smaller = {name: int(0.95 * getattr(config.scan, name)) for name in ("columns", "rows")}
        config = config.model_copy(update={"scan": config.scan.model_copy(update=smaller)})
    return config


def refused(config: RigConfig, folder: Path) -> str:
    """Return what a dry run refuses, as a sentence; empty where it accepts the rig."""
    try:
        check(ScanPlan.grid(config), RigState(config), folder)
    except (RigError, LimitError) as problem:
        return str(problem)
    return ""
