"""The file of pictures of the wall by which a mirror is calibrated; see docs/calibration/galvo.md."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.atomic import appearing, refusals_told
from rig.calibrate import Floats, require
from rig.errors import DataFileError, in_shell
from rig.files.blocks import read
from rig.files.check import check_format, plain, reading
from rig.files.fresh import FreshFile
from rig.files.recorded import RecordedFile
from rig.files.start import write_origin, write_root
from rig.model.config import RigConfig
from rig.model.devices import Board, Settings, WallCamera

FORMAT, VERSION = "rig-wall-images", 1
#: What pictures show: the board, the wall in the dark, the wall with the spot.
SERIES = ("board", "dark", "lit")

Image = NDArray[np.uint16]


class ImagesWriter:
    """Appends pictures of all cameras to a new file; use `writing`.

    Parameters
    ----------
    file
        An open, empty file.
    cameras
        Whose pictures it gets.
    """

    def __init__(self, file: h5py.File, cameras: Sequence[WallCamera]) -> None:
        self._cameras = cameras
        self._groups = [file.create_group(f"cameras/{number}") for number, _ in enumerate(cameras, 1)]
        for group, camera in zip(self._groups, cameras, strict=True):
            group.attrs["name"] = camera.name
        self._angles = file.create_dataset("geometry/mirror_rad", (0, 2), "f8", maxshape=(None, 2))

    def take(self, series: str, mirror_rad: tuple[float, float] | None = None) -> None:
        """Take a picture with each camera, and append it to ``series``; lit ones with the mirror's angles."""
        for group, camera in zip(self._groups, self._cameras, strict=True):
            image = camera.image()
            if series not in group:
                group.create_dataset(
                    series, (0, *image.shape), "u2", maxshape=(None, *image.shape),
                    chunks=(1, *image.shape), compression="gzip", compression_opts=1, shuffle=True,
                )  # fmt: skip
            _append(group[series], image)
            group.attrs["full"] = camera.full  # known for certain after a picture
        if mirror_rad is not None:
            _append(self._angles, np.array(mirror_rad))


def _append(dataset: h5py.Dataset, value: NDArray) -> None:
    dataset.resize(len(dataset) + 1, axis=0)
    dataset[-1] = value


@contextmanager
def writing(
    path: Path, config: RigConfig, devices: Mapping[str, Settings], cameras: Sequence[WallCamera]
) -> Iterator[ImagesWriter]:
    """Open a new file of pictures; it appears when the block ends well."""
    with refusals_told(path), appearing(path) as partial, FreshFile(partial) as file:
        write_root(file, FORMAT, VERSION)
        write_origin(file, config, devices, config.rehearsed, in_shell("rig", *sys.argv[1:]))
        used = config.cameras
        file.create_group("board").attrs.update(
            columns=used.board_columns,
            rows=used.board_rows,
            square_m=used.board_square_m,
            marks_m=used.board_marks_m,
            placed_to_m=used.board_placed_to_m,
        )
        yield ImagesWriter(file, cameras)


class WallImages(RecordedFile):
    """A file of pictures of the wall.

    Raises DataFileError if it is missing, damaged, or of another kind. CalibrationError If it lacks the
    pictures of two cameras.

    Attributes
    ----------
    mirror_rad
        (N, 2) commanded angles of the lit pictures.
    cameras, full
        Name of each camera, and the count at which its pixels are full.
    board
        The checkerboard.
    marks_m, placed_to_m
        (M, 2) where the first inner corners of the first boards were on the wall, and how well either end of
        it was held to its mark [m].
    """

    def _read(self) -> None:
        check_format(self.path, self._file, FORMAT, (VERSION,))
        self.mirror_rad: Floats = read(self._file["geometry/mirror_rad"]).astype(float)
        self._groups = [self._file["cameras"][name] for name in sorted(self._file["cameras"])]
        self.cameras = [str(plain(group.attrs["name"])) for group in self._groups]
        self.full = [int(plain(group.attrs["full"])) for group in self._groups]
        board = self._file["board"].attrs
        self.board = Board(int(board["columns"]), int(board["rows"]), float(board["square_m"]))
        self.marks_m: Floats = np.reshape(board["marks_m"], (-1, 2)).astype(float)
        self.placed_to_m = float(board["placed_to_m"])
        require(
            len(self.cameras) == 2,
            f"{self.path} has pictures of {len(self.cameras)} cameras, but two are needed",
        )
        for group in self._groups:
            self._refuse_incomplete(group)

    def _refuse_incomplete(self, group: h5py.Group) -> None:
        missing = ", ".join(series for series in SERIES if series not in group)
        require(not missing, f"{self.path} lacks the pictures {missing} of {group.name}: measure again")
        lit, dark = len(group["lit"]), len(group["dark"])
        if lit != len(self.mirror_rad) or dark < 2:
            raise DataFileError(
                f"{self.path} has {lit} lit and {dark} dark pictures in {group.name} for "
                f"{len(self.mirror_rad)} mirror angles; one lit picture for each angle and two dark "
                "pictures are needed"
            )

    def pictures(self, camera: int, series: str) -> Iterator[Image]:
        """Return one camera's pictures, one after the other."""
        with reading(self.path):
            stored = self._groups[camera][series]
            for number in range(len(stored)):
                yield read(stored, slice(number, number + 1))[0]
