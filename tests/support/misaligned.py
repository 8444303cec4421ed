"""The simulated rig with all its faults and misalignments, its truth, and a galvo calibration of it."""

from math import dist

import numpy as np
from scipy.optimize import brentq, least_squares

from recon.capture import C_M_PER_S
from rig.bench.simulated import true_geometry
from rig.model.calibrations.chosen import Calibrations
from rig.model.calibrations.kinds import GalvoModel
from rig.model.config import RigConfig, built_in_with
from rig.model.pointing import Pointing
from rig.model.state import RigState
from simulators.detector import FWHM_PER_SIGMA, Detector
from simulators.detector.first_bounce import direct_s
from simulators.optics.light import Optics

FAULTS = {
    "memory": 1e-5,
    "reflections_per_pulse": 1e-4,
    "failed_gates": 0.01,
    "nonlinearity": 0.002,
    "drift_per_minute": "1ps",
}


def misaligned(
    seed: int = 0, signs=None, mirrors: int = 1, kind: str = "optotune", incidence: str | None = None
) -> RigConfig:
    """Everything is wrong at once; ``signs`` (16,) turns the directions round.

    With an ``incidence``, one mirror is met at that angle by its configuration, and really 2 degrees beside
    it, from a side that is 3 degrees off.
    """
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
    galvo = {"kind": kind, "mirrors": mirrors, "separation": "15mm" if mirrors == 2 else "0mm"}
    if incidence:
        misalignment["mirror_incidence"] = ["2deg", "-3deg"]
        galvo |= {"incidence": incidence, "max_angle_x": "35deg", "max_angle_y": "35deg"}
    simulation = {"seed": seed, "faults": FAULTS, "misalignment": misalignment}
    return built_in_with({"simulation": simulation, "galvo": galvo})


def misaligned_at_random(seed: int, folder=None, **changes) -> RigConfig:
    """Return a rig that stands 1 to 3 cm from where it says, before a tilted wall, with 3 ns of cable."""
    rng = np.random.default_rng(seed)
    shifts_m = rng.uniform(0.01, 0.03, 6) * rng.choice([-1, 1], 6)
    centimetres = [f"{100 * shift_m}cm" for shift_m in shifts_m]
    wrong = {
        "wall_tilt": ["5deg", "2deg"],
        "galvo_shift": centimetres[:3],
        "spad_shift": centimetres[3:],
        "mirror_turn": ["1deg", "1deg", "1deg"],
        "mirror_offset": ["0.5deg", "-0.3deg"],
        "mirror_gain": [1.005, 0.996],
        "cable_delay": "3ns",
    }
    calibration = {"calibration": {"folder": str(folder)}} if folder else {}
    simulation = {"seed": seed, "faults": FAULTS, "misalignment": wrong}
    return built_in_with({"simulation": simulation, **calibration, **changes})


def true_spots_m(config: RigConfig, angles_rad) -> np.ndarray:
    """(K, 2) places where the beam really meets the wall for (K, 2) commanded angles."""
    geometry = true_geometry(config)
    return np.array([geometry.laser_spot_m((float(x), float(y)))[:2] for x, y in angles_rad])


def errors_m(calibration, config: RigConfig, spots_m) -> np.ndarray:
    """(K, 2) how far the beam is from (K, 3) spots that the calibrated mirror was asked for."""
    angles = calibration.pointing().angles_rad(spots_m)
    return true_spots_m(config, angles) - np.asarray(spots_m)[:, :2]


def true_arrivals_s(config: RigConfig, mirror_rad) -> np.ndarray:
    """(N,) when first bounces really arrive."""
    bench = true_geometry(config)
    return np.array([direct_s((x, y, 0.0), bench) for x, y in true_spots_m(config, mirror_rad)])


def true_delays_s(config: RigConfig, mirror_rad) -> np.ndarray:
    """(N,) what is really to be subtracted for rectified time."""
    bench = true_geometry(config)
    back_m = dist(bench.detector_head_m, bench.channels[0].spot_m)
    spots_m = np.pad(true_spots_m(config, mirror_rad), ((0, 0), (0, 1)))
    there_m = np.linalg.norm(spots_m - bench.galvo_m, axis=1)
    return bench.electronics_delay_s + (there_m + back_m) / C_M_PER_S


def true_width_s() -> float:
    """Full width at half maximum of pulse, jitter, electronics and tail, convolved on a fine grid."""
    detector, pulse_s = Detector(), Optics().pulse_fwhm_s
    step_s = 0.05e-12
    times_s = np.arange(-1e-9, 1e-9, step_s)
    fwhms_s = (pulse_s, detector.jitter_fwhm_s, detector.electronics_fwhm_s)
    sigma_s = np.sqrt(sum(width_s**2 for width_s in fwhms_s)) / FWHM_PER_SIGMA
    core = np.exp(-((times_s / sigma_s) ** 2) / 2)
    core /= core.sum()
    late_s = np.arange(0, 0.8e-9, step_s)
    late = np.exp(-late_s / detector.tail_s)
    delayed = np.convolve(core, late / late.sum())[: len(core)]
    response = (1 - detector.tail_fraction) * core + detector.tail_fraction * delayed
    half = response.max() / 2

    def above(at_s):
        return np.interp(at_s, times_s, response) - half

    top_s = times_s[response.argmax()]
    return brentq(above, top_s, top_s + 0.2e-9) - brentq(above, top_s - 0.2e-9, top_s)


def galvo_calibration(config: RigConfig, spot_error_m: float, seed: int) -> Calibrations:
    """Fit the mirror's model to its true spots on a grid, each measured with an error along x and along y."""
    rng = np.random.default_rng((seed, 9))
    x_m, y_m = np.meshgrid(np.linspace(-0.85, 0.85, 11), np.linspace(-0.62, 0.62, 9))
    nominal = RigState(config).pointing
    angles = nominal.angles_rad(np.stack([x_m.ravel(), y_m.ravel(), 0 * x_m.ravel()], axis=1))
    seen_m = true_spots_m(config, angles) + spot_error_m * rng.standard_normal((len(angles), 2))
    start = np.concatenate([nominal.mirror_m, nominal.rotation_rad, nominal.offset_rad, nominal.gain])
    scale = np.repeat([0.3, 0.1, 0.02, 0.02], [3, 3, 2, 2])

    def model(values) -> Pointing:
        parts = np.split(values, [3, 6, 8])
        return Pointing(*(tuple(part.tolist()) for part in parts))

    def residuals(values):
        off_m = (model(values).spots_m(angles)[:, :2] - seen_m).ravel()
        return np.concatenate([off_m / spot_error_m, (values - start) / scale])

    found = least_squares(residuals, start, x_scale=scale)
    slopes = found.jac[: 2 * len(angles)]
    variance = np.einsum("ni,ij,nj->n", slopes, np.linalg.inv(found.jac.T @ found.jac), slopes)
    pointing = model(found.x)
    return Calibrations(
        {
            "galvo": GalvoModel(
                valid_days=30,
                rig_name=config.name,
                devices={},
                measured_from={},
                simulated=True,
                method="cameras",
                mirror_m=pointing.mirror_m,
                rotation_rad=pointing.rotation_rad,
                offset_rad=pointing.offset_rad,
                gain=pointing.gain,
                mirrors=1,
                separation_m=0.0,
                area_m=[],
                spot_error_m=float(spot_error_m * np.sqrt(2 * variance.mean())),
                residual_m=spot_error_m,
                positions=len(angles),
            )
        }
    )
