"""Gu et al. 2023 (non-planar relay surfaces, 3D-RSD): MATLAB with ``total_rect_data``.

``total_rect_data`` (positions, t) rectified counts, added up over the detector's pixels; ``ts`` bin width
[s]; ``camera_pos`` (positions, 3) the scanned laser spots, ``laser_pos_base`` (or ``laser_pos``) the
detector's spot, metres: the two names are exchanged in the published files, as their description says.
"""

from rig.errors import DataFileError
from rig.importers.content import Content, as_counts
from rig.importers.options import Options, positive
from rig.importers.places import zeros_as_missing
from rig.importers.source import Source
from rig.importers.wall import WallFrame, named

NAME = "Gu 2023, 3D-RSD"
SIGN = "MATLAB with total_rect_data (positions, t), camera_pos, laser_pos_base and ts"
PARTS = ("total_rect_data", "camera_pos", "laser_pos_base or laser_pos", "ts")


def recognise(source: Source) -> bool:
    """Return whether the file has this layout."""
    return source.holds(*PARTS)


def read(source: Source, options: Options) -> Content:
    """Read the file.

    Raises
    ------
    DataFileError
        If arrays do not fit together, or there is more than one detector spot.
    """
    signal = source.matlab_array("total_rect_data")
    (lit_m,), unmeasured = zeros_as_missing(source.matlab_places("camera_pos"))
    seen_m = source.matlab_places("laser_pos_base" if source.has("laser_pos_base") else "laser_pos")
    if signal.ndim != 2 or signal.dtype.kind not in "uif" or len(signal) != len(lit_m) or len(seen_m) != 1:
        raise DataFileError(
            f"{source.path}: total_rect_data has shape {signal.shape} with {len(lit_m)} spots of camera_pos "
            f"and {len(seen_m)} of laser_pos; (spots, t) and one detector spot are needed"
        )
    with named(source.path):
        frame = WallFrame.amid(lit_m, seen_m)
    counts = as_counts(signal)
    return Content(
        laser_m=frame.bring(lit_m),
        detector_m=frame.bring(seen_m),
        bins=counts.shape[1],
        bin_width_s=positive(source.numbers("ts", 1)[0], f"{source.path}: ts"),
        first_bin_s=0.0,
        dtype=counts.dtype,
        blocks=[counts],
        frame=frame,
        assumed=(
            "camera_pos holds the scanned laser spots and laser_pos the detector's: the published names are "
            "exchanged",
            "rectified: bin 0 starts when the pulse is on the wall; z grows into the room",
            *unmeasured,
        ),
    )
