"""Times and places that cannot both be in seconds and metres: a wrong unit makes a wrong picture."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from recon.capture import C_M_PER_S
from rig.errors import DataFileError
from rig.importers.content import Content
from rig.importers.held import least_delay_s
from rig.importers.wall import named, require_near
from rig.model.quantities import show, show_length

#: Bins of any instrument and renderer: light goes 0.3 um to 30 m in them.
_LEAST_S, _MOST_S = 1e-15, 1e-7
#: Part of the wall's extent that light has gone when the record ends: of a record of what is hidden it is
#: hardly less than the first.
_SHORT = 0.2
#: Such parts for the record and for a bin below which, both together, a unit was misread.
_MISREAD, _MISREAD_BIN = 1e-2, 1e-4


def plausible(content: Content, path: Path) -> Content:
    """Hold a capture's times against its places; return it, with what is doubtful as a sentence.

    A record that is too short to image what is hidden is still one to count or to draw: a curve of one bin,
    or a few bins cut out. It is reported. It is refused where its bins, too, are finer than anything resolves
    on such a wall: light goes less than 0.1 mm in a bin, for each metre of the wall. Millimetres as metres,
    or nanoseconds as picoseconds, are wrong by 1000: bins of 4 ps over 1 m (1.2 mm a bin) become such.

    Raises
    ------
    DataFileError
        If places lie beyond any room, bins are none of a photon counter, or bins and record are both far too
        short for the wall.
    """
    with named(path):
        _require_near(content)
    width_s = content.bin_width_s
    if not _LEAST_S <= width_s <= _MOST_S:
        raise DataFileError(
            f"{path}: its bins would be {show(width_s, 's')} wide, which no photon counter has. Its times "
            "are not in the unit that docs/importing.md names for this layout, or --bin-width is wrong"
        )
    end_s = content.first_bin_s + content.bins * width_s
    wall_m = float(np.ptp(np.concatenate([content.laser_m, content.detector_m]), axis=0).max())
    if 0 < C_M_PER_S * end_s < _MISREAD * wall_m and C_M_PER_S * width_s < _MISREAD_BIN * wall_m:
        raise DataFileError(f"{path}: {_small(wall_m, end_s)}")
    end_s -= least_delay_s(content)
    if end_s <= 0:
        said = (
            f"its record ends {show(-end_s, 's')} before the pulse is on the wall, so that it holds no light "
            "of a hidden object; check its time origin, and what is subtracted from its times"
        )
    elif C_M_PER_S * end_s < _SHORT * wall_m:
        said = _small(wall_m, end_s)
    else:
        return content
    return replace(content, assumed=(*content.assumed, said))


def _require_near(content: Content) -> None:
    require_near("the laser's spots", content.laser_m)
    require_near("the detector's spots", content.detector_m)
    if content.delays is not None:
        require_near(
            "the laser's and the detector's heads",
            np.array([content.delays.laser_head_m, content.delays.detector_head_m]),
        )


def _small(wall_m: float, end_s: float) -> str:
    return (
        f"its spots span {show_length(wall_m)}, but its record ends when light has gone "
        f"{show_length(C_M_PER_S * end_s)}, at {show(end_s, 's')}; places are in m, and times in the unit "
        "that docs/importing.md names for this layout: check both, and --wall-size and --bin-width if given"
    )
