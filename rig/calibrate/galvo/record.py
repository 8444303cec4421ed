"""The record of a calibrated mirror."""

from typing import Any, Literal

import numpy as np

from rig.calibrate.galvo.lens import Floats
from rig.calibrate.galvo.model_fit import FittedMirror, spot_covariances_m2
from rig.calibrate.routine import Origin
from rig.model.calibrations.kinds import GalvoModel


def galvo_model(
    method: Literal["cameras", "flight"],
    mirror: FittedMirror,
    angles_rad: Floats,
    spots_m: Floats,
    source: Origin,
    **more: Any,
) -> GalvoModel:
    """Return the record of a fitted mirror, with the angles and spots that it was fitted to, and ``more``."""
    spread_m2 = spot_covariances_m2(mirror.pointing, mirror.covariance, angles_rad)
    pointing = mirror.pointing
    return GalvoModel(
        **source,
        valid_days=30,
        method=method,
        mirror_m=pointing.mirror_m,
        rotation_rad=pointing.rotation_rad,
        offset_rad=pointing.offset_rad,
        gain=pointing.gain,
        mirrors=pointing.mirrors,
        separation_m=pointing.separation_m,
        area_m=list(pointing.area_m),
        covariance=tuple(tuple(row) for row in mirror.covariance.tolist()),
        spot_error_m=float(np.sqrt(np.trace(spread_m2, axis1=1, axis2=2).mean())),
        residual_m=mirror.residual_m,
        mirror_rad=tuple((float(x), float(y)) for x, y in angles_rad),
        spots_m=tuple((float(x), float(y)) for x, y in spots_m),
        **{"positions": len(angles_rad), **more},
    )
