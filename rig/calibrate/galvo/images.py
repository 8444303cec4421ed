"""The file of pictures of the wall by which a mirror is calibrated; see docs/calibration/galvo.md."""

import hashlib
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

import rig
from rig.atomic import appearing
from rig.calibrate.geometry_fit import Floats
from rig.errors import CalibrationError, DataFileError
from rig.files.check import check_format, open_hdf5, plain, reading
from rig.model.calibrations.base import utc_now
from rig.model.config import RigConfig, recorded
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
                whole = (1, *image.shape)
                group.create_dataset(
                    series, (0, *image.shape), "u2", maxshape=(None, *image.shape),
                    chunks=whole, compression="gzip", compression_opts=1, shuffle=True,
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
    path: Path, config: RigConfig, devices: dict[str, Settings], cameras: Sequence[WallCamera]
) -> Iterator[ImagesWriter]:
    """Open a new file of pictures; it appears when the block ends well."""
    with appearing(path) as partial, h5py.File(partial, "w") as file:
        file.attrs.update(
            format=FORMAT,
            version=VERSION,
            created=utc_now().isoformat(),
            software=f"nlos-rig {rig.__version__}",
        )
        start = file.create_group("start")
        start.attrs.update(
            configuration=config.model_dump_json(),
            simulated=config.simulated,
            command=" ".join(["rig", *sys.argv[1:]]),
        )
        for name, settings in devices.items():
            file.create_group(f"devices/{name}").attrs.update(settings)
        board = file.create_group("board").attrs
        used = config.cameras
        board.update(columns=used.board_columns, rows=used.board_rows, square_m=used.board_square_m)
        board.update(marks_m=used.board_marks_m, placed_to_m=used.board_placed_to_m)
        yield ImagesWriter(file, cameras)


class WallImages:
    """A file of pictures of the wall; use as a context manager.

    Raises
    ------
    DataFileError
        If it is missing, damaged, or of another kind.
    CalibrationError
        If it lacks the pictures of two cameras.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._file = open_hdf5(self.path)
        try:
            check_format(self.path, self._file, FORMAT, (VERSION,))
            with reading(self.path):
                self.mirror_rad: Floats = self._file["geometry/mirror_rad"][()].astype(float)
                self.cameras = [str(plain(group.attrs["name"])) for group in self._groups]
                self.full = [int(plain(group.attrs["full"])) for group in self._groups]
            self._refuse_incomplete()
        except BaseException:
            self._file.close()
            raise

    @property
    def _groups(self) -> list[h5py.Group]:
        return [self._file["cameras"][name] for name in sorted(self._file["cameras"])]

    def _refuse_incomplete(self) -> None:
        if len(self.cameras) != 2:
            raise CalibrationError(f"{self.path} has pictures of {len(self.cameras)} cameras, two are needed")
        for group in self._groups:
            missing = [series for series in SERIES if series not in group]
            if missing:
                raise CalibrationError(
                    f"{self.path} lacks the pictures {', '.join(missing)} of {group.name}: measure again"
                )
            lit = len(group["lit"])
            if lit != len(self.mirror_rad) or len(group["dark"]) < 2:
                raise DataFileError(
                    f"{self.path} has {lit} lit and {len(group['dark'])} dark pictures in {group.name} for "
                    f"{len(self.mirror_rad)} mirror angles; one lit picture an angle, and two dark ones, "
                    "belong there"
                )

    def pictures(self, camera: int, series: str) -> Iterator[Image]:
        """Return one camera's pictures, one after the other."""
        with reading(self.path):
            dataset = self._groups[camera][series]
            for index in range(len(dataset)):
                yield dataset[index]

    @property
    def board(self) -> Board:
        """The checkerboard."""
        return Board(
            int(self._of_board("columns")), int(self._of_board("rows")), float(self._of_board("square_m"))
        )

    @property
    def marks_m(self) -> Floats:
        """(M, 2) where the first inner corners of the first boards were on the wall [m]."""
        return np.reshape(self._of_board("marks_m"), (-1, 2)).astype(float)

    @property
    def placed_to_m(self) -> float:
        """How well either end of it was held to its mark [m]."""
        return float(self._of_board("placed_to_m"))

    def _of_board(self, name: str) -> Any:
        with reading(self.path):
            return plain(self._file["board"].attrs[name])

    @property
    def config(self) -> RigConfig:
        """The configuration with which it was measured."""
        with reading(self.path):
            return recorded(plain(self._file["start"].attrs["configuration"]))

    @property
    def simulated(self) -> bool:
        """Whether the pictures were computed."""
        with reading(self.path):
            return bool(plain(self._file["start"].attrs["simulated"]))

    @property
    def devices(self) -> dict[str, Settings]:
        """Settings of each device, ``identity`` among them."""
        with reading(self.path):
            groups = self._file.get("devices", {})
            return {name: {k: plain(v) for k, v in group.attrs.items()} for name, group in groups.items()}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
