"""What a volume says of itself, in words for pictures."""

from rig.files.volume import Volume
from rig.model.quantities import show, show_length


def parameters_line(volume: Volume) -> str:
    """Return the parameters that a reader asks for first, as far as the volume names them."""
    told = []
    for key, value in volume.parameters.items():
        if key in {"camera", "solver"}:
            told.append(str(value))
        elif key == "wavelength_m" and isinstance(value, int | float):
            told.append(f"wavelength {show_length(value)}")
        elif key == "cycles":
            told.append(f"{value:g} cycles")
        elif key == "preview_cell_m":
            told.append(f"preview, cells of {show_length(value)}")
        elif key == "estimated":
            told += [f"estimated: {words}" for words in value]
    return ", ".join(told)


def caption(volume: Volume) -> str:
    """Return where a picture comes from, so that a printed one can be traced to its scan."""
    origin = volume.parameters.get("origin", {})
    told = []
    if "positions" in origin:
        told.append(f"{origin['positions']:,} positions")
    if "exposure_s" in origin:
        told.append(f"{show(origin['exposure_s'], 's')} each")
    if "photons" in origin:
        told.append(f"{origin['photons']:,} photons")
    if "measured" in origin:
        told.append(f"measured {origin['measured'][:16].replace('T', ' ')} UTC")
    if "rig" in origin:
        told.append(str(origin["rig"]))
    if volume.scan_digest:
        told.append(f"SHA-256 of the scan {volume.scan_digest[:12]}…")
    return ", ".join(told)
