"""The simulated rig with all its faults and misalignments, and where its beam really goes."""

import numpy as np

from rig.bench.simulated import true_geometry
from rig.model.config import RigConfig, built_in_with

FAULTS = {
    "memory": 1e-5,
    "reflections_per_pulse": 1e-4,
    "failed_gates": 0.01,
    "nonlinearity": 0.002,
    "drift_per_minute": "1ps",
}


def misaligned(seed: int = 0, signs=None, mirrors: int = 1) -> RigConfig:
    """Everything is wrong at once; ``signs`` (16,) turns the directions round."""
    s = np.ones(16) if signs is None else signs
    misalignment = {
        "wall_tilt": [f"{5 * s[0]}deg", f"{2 * s[1]}deg"],
        "galvo_shift": [f"{2 * s[2]}cm", f"{-s[3]}cm", f"{3 * s[4]}cm"],
        "spad_shift": [f"{-2 * s[5]}cm", f"{1.5 * s[6]}cm", f"{s[7]}cm"],
        "mirror_turn": [f"{s[8]}deg", f"{s[9]}deg", f"{s[10]}deg"],
        "mirror_offset": [f"{0.5 * s[11]}deg", f"{-0.3 * s[12]}deg"],
        "mirror_gain": [1 + 0.005 * s[13], 1 - 0.004 * s[14]],
        "cable_delay": f"{3 * s[15]}ns",
    }
    simulation = {"seed": seed, "faults": FAULTS, "misalignment": misalignment}
    galvo = {"mirrors": mirrors, "separation": "15mm"} if mirrors == 2 else {}
    return built_in_with({"simulation": simulation, "galvo": galvo})


def true_spots_m(config: RigConfig, angles_rad) -> np.ndarray:
    """(K, 2) places where the beam really meets the wall for (K, 2) commanded angles."""
    geometry = true_geometry(config)
    return np.array([geometry.laser_spot_m((float(x), float(y)))[:2] for x, y in angles_rad])


def errors_m(calibration, config: RigConfig, spots_m) -> np.ndarray:
    """(K, 2) how far the beam is from (K, 3) spots that the calibrated mirror was asked for."""
    angles = calibration.pointing().angles_rad(spots_m)
    return true_spots_m(config, angles) - np.asarray(spots_m)[:, :2]
