"""A calibration in a line."""

from rig.model.calibrations.base import Calibration
from rig.model.calibrations.kinds import (
    BinWidths,
    DarkRates,
    GalvoModel,
    GateOpening,
    MirrorLag,
    Response,
    TimeZero,
)
from rig.model.quantities import show, show_length


def headline(calibration: Calibration) -> str:
    """Return what was found and how well it is known."""
    match calibration:
        case GalvoModel() as found:
            by = "cameras" if found.method == "cameras" else "times of flight"
            return f"spots known to {show_length(found.spot_error_m, 2)}, by {by} at {found.positions}"
        case TimeZero() as found:
            return (
                f"{show(found.electronics_delay_s, 's', 5)} of cable and electronics, "
                f"rectified time known to {show(found.rectified_error_s, 's', 2)}"
            )
        case MirrorLag() as found:
            return (
                f"{show(found.lag_s, 's', 4)} ± {show(found.lag_error_s, 's', 2)} behind its command, "
                f"at {found.speed_m_per_s:.3g} m/s along x"
            )
        case Response() as found:
            return f"{show(found.fwhm_s, 's', 3)} ± {show(found.fwhm_error_s, 's', 2)} wide at half maximum"
        case DarkRates() as found:
            return (
                f"dark {found.dark_hz:.3g} ± {found.dark_error_hz:.1g} Hz, "
                f"ambient {found.ambient_hz:.4g} ± {found.ambient_error_hz:.1g} Hz, "
                f"afterpulses {found.afterpulse_probability:.2%}"
            )
        case GateOpening() as found:
            without = sum(earliest is None for earliest in found.earliest_s)
            return (
                f"open at {show(found.gate_delay_s, 's', 4)} for {show(found.gate_width_s, 's', 3)}; "
                f"{without} of {len(found.earliest_s)} positions cannot be gated"
            )
        case BinWidths() as found:
            # where two standard errors below it is nothing, nothing was seen
            believed = f"of a counted deviation {found.kept:.0%} is believed"
            if 2 * found.nonlinearity**2 <= found.nonlinearity_at_most**2:
                return (
                    f"{found.counts_per_bin:.0f} counts a bin show no difference of widths; it is "
                    f"{found.nonlinearity_at_most:.2%} rms at most, and {believed}"
                )
            return (
                f"widths differ by {found.nonlinearity:.2%} rms ({found.nonlinearity_at_most:.2%} at most); "
                f"{believed}"
            )
    raise TypeError(f"no headline for {type(calibration).__name__}")
