"""Reading a scan file."""

import hashlib
import json
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture, Histograms
from rig.errors import DataFileError
from rig.files.check import check_format, check_layout, open_hdf5, plain, reading
from rig.files.description import Settings
from rig.files.histograms import DenseHistograms, TaggedHistograms
from rig.files.layout import SCAN
from rig.files.summary import summarise
from rig.model.delays import PathDelays

#: Photons read at once when all are looked through.
PHOTONS_AT_ONCE = 2**22


class ScanFile:
    """A scan file, checked against its layout when it is opened; use as a context manager.

    Attributes
    ----------
    path
        Where it is.
    positions, bins
        Positions planned P, and bins B.
    laser_m, detector_m
        (P, 3) and (1 or P, 3) spots on the wall.
    bin_width_s, first_bin_s
        The time axis, in the file's time.
    legs, delay_s
        What to subtract for rectified time: the legs, or a measured (P,) delay; both None where the file is
        rectified.
    done
        (P,) which positions were measured.

    Raises
    ------
    DataFileError
        If the file is missing, truncated, foreign, or lacks what is needed.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = open_hdf5(self.path)
        try:
            with reading(self.path):
                check_format(self.path, self._file, "rig-scan", 1)
                sizes = check_layout(self.path, self._file, SCAN)
                self._read_geometry()
                self._read_time()
                self._read_photons(sizes)
        except BaseException:
            self._file.close()
            raise

    def _read_geometry(self) -> None:
        geometry = self._file["geometry"]
        self.laser_m: NDArray[np.float64] = geometry["laser_m"][()].astype(float)
        self.detector_m: NDArray[np.float64] = geometry["detector_m"][()].astype(float)
        self.positions = len(self.laser_m)
        if not (np.isfinite(self.laser_m).all() and np.isfinite(self.detector_m).all()):
            raise DataFileError(
                f"{self.path} has a position that is not a number in /geometry; it cannot be used"
            )
        if self.positions == 0:
            raise DataFileError(f"{self.path} holds no positions; measure again")

    def _read_time(self) -> None:
        transients, geometry = self._file["transients"].attrs, self._file["geometry"].attrs
        self.bin_width_s = float(plain(transients["bin_width_s"]))
        self.first_bin_s = float(plain(transients["first_bin_s"]))
        self.time_origin: str = plain(transients["time_origin"])
        if not self.bin_width_s > 0:
            raise DataFileError(
                f"{self.path} has bin_width_s = {self.bin_width_s} on /transients; it must be positive"
            )
        if self.time_origin not in {"wall", "laser"}:
            raise DataFileError(
                f"{self.path} has time_origin = '{self.time_origin}' on /transients; "
                f"it must be 'wall' or 'laser'"
            )
        self.legs: PathDelays | None = None
        self.delay_s: NDArray[np.float64] | None = None
        if self.time_origin == "laser" and "delay_s" in self._file["geometry"]:
            self.delay_s = self._file["geometry/delay_s"][()].astype(float)
            if not np.isfinite(self.delay_s).all():
                raise DataFileError(f"{self.path} has a delay that is not a number in /geometry/delay_s")
        elif self.time_origin == "laser":
            names = ("laser_head_m", "detector_head_m", "electronics_delay_s")
            missing = [name for name in names if name not in geometry]
            if missing:
                raise DataFileError(
                    f"{self.path} holds the laser's time, but /geometry lacks the attributes "
                    f"{', '.join(missing)} that give the wall's time; add them or delay_s, or rectify "
                    "the data and set time_origin to 'wall'"
                )
            laser_head_m, detector_head_m, delay_s = (plain(geometry[name]) for name in names)
            self.legs = PathDelays(laser_head_m.astype(float), detector_head_m.astype(float), float(delay_s))

    def _read_photons(self, sizes: dict[str, int]) -> None:
        transients = self._file["transients"]
        dense = "counts" in transients
        tagged = [name for name in ("photons", "photon_offset") if name in transients]
        if dense == bool(tagged) or len(tagged) == 1:
            found = ", ".join(["counts"] * dense + tagged) or "neither"
            raise DataFileError(
                f"{self.path} must hold either /transients/counts, or /transients/photons with "
                f"/transients/photon_offset; it has {found}"
            )
        self.done: NDArray[np.bool_] = np.ones(self.positions, bool)
        if "done" in transients:
            self.done = transients["done"][()].astype(bool)
        if dense:
            self.bins = sizes["bins"]
            counts = transients["counts"]
            if counts.dtype.kind == "f" and plain(counts.attrs.get("kind")) != "expectation":
                raise DataFileError(
                    f"{self.path}: /transients/counts has type {counts.dtype}; photon counts are "
                    "unsigned integers. Set its attribute kind to 'expectation' if it is a rendered or "
                    "processed signal"
                )
            self._histograms: Histograms = DenseHistograms(self.path, counts, self.done)
        else:
            photons, offset = transients["photons"], transients["photon_offset"][()].astype(np.int64)
            if offset[0] != 0 or offset[-1] != len(photons) or (np.diff(offset) < 0).any():
                raise DataFileError(
                    f"{self.path}: /transients/photon_offset must rise from 0 to the {len(photons)} photons; "
                    f"it goes from {offset[0]} to {offset[-1]}"
                )
            self.bins = self._tagged_bins(photons)
            self._histograms = TaggedHistograms(self.path, photons, offset, self.bins, self.done)
        if self.bins < 1:
            raise DataFileError(f"{self.path} has {self.bins} bins; at least one is needed")

    def _tagged_bins(self, photons: h5py.Dataset) -> int:
        """Return the number of bins of the time-tagged form: as said, or else up to the last photon."""
        for owner in (self._file["transients"], photons):
            if "bins" in owner.attrs:
                return int(plain(owner.attrs["bins"]))
        starts = range(0, len(photons), PHOTONS_AT_ONCE)
        return 1 + max((int(photons[start : start + PHOTONS_AT_ONCE].max()) for start in starts), default=0)

    @property
    def status(self) -> str:
        """``complete``, ``interrupted`` or ``failed``."""
        return str(self._attribute("stop", "status", "interrupted"))

    @property
    def reason(self) -> str:
        """Why the run ended, in words."""
        return str(
            self._attribute("stop", "reason", "" if "stop" in self._file else "it has no closing record")
        )

    @property
    def photons(self) -> int:
        """Sum of all counts as the closing record has it; 0 without one."""
        return int(self._attribute("stop", "photons", 0))

    @property
    def warnings(self) -> list[str]:
        """What went less than well."""
        return list(self._json("stop", "warnings", "[]"))

    @property
    def plan(self) -> dict[str, Any]:
        """The scan plan; empty where the file does not say."""
        return dict(self._json("start", "plan", "{}"))

    @property
    def configuration(self) -> dict[str, Any]:
        """The resolved configuration; empty where the file does not say."""
        return dict(self._json("start", "configuration", "{}"))

    @property
    def simulated(self) -> bool:
        """Whether the photons were computed rather than measured."""
        return bool(self._attribute("start", "simulated", False))

    @property
    def created(self) -> str:
        """When the file was created, UTC, ISO 8601; empty where the file does not say."""
        return str(self._attribute("/", "created", ""))

    @property
    def software(self) -> str:
        """What wrote the file; empty where the file does not say."""
        return str(self._attribute("/", "software", ""))

    @property
    def command(self) -> str:
        """The command that made the file; empty where the file does not say."""
        return str(self._attribute("start", "command", ""))

    @property
    def imported(self) -> dict[str, Any]:
        """File, sha256, layout and assumptions of an import; empty for a scan."""
        return dict(self._json("start", "imported", "{}"))

    @property
    def devices(self) -> dict[str, Settings]:
        """Settings of each device, ``identity`` among them."""
        groups = self._file.get("devices", {})
        with reading(self.path):
            return {
                name: {key: plain(value) for key, value in group.attrs.items() if key != "description"}
                for name, group in groups.items()
            }

    @property
    def calibrations(self) -> dict[str, str]:
        """JSON text of each calibration that the scan used, by kind."""
        with reading(self.path):
            group = self._file.get("calibration", {})
            return {kind: dataset.asstr()[()] for kind, dataset in group.items()}

    @property
    def mirror_rad(self) -> NDArray[np.float64] | None:
        """(P, 2) commanded mirror angles; None where the file does not say."""
        with reading(self.path):
            angles = self._file.get("geometry/mirror_rad")
            return None if angles is None else angles[()].astype(float)

    @property
    def fade_from_s(self) -> float | None:
        """Rectified time before which the record holds the wall's own light."""
        return self._time("fade_from_s")

    @property
    def gate_start_s(self) -> float | None:
        """When the detector's gate opens, in the file's time."""
        return self._time("gate_start_s")

    @property
    def gate_stop_s(self) -> float | None:
        """When the detector's gate closes, in the file's time."""
        return self._time("gate_stop_s")

    @property
    def instrument_response_s(self) -> float | None:
        """Full width at half maximum of the instrument response."""
        return self._time("instrument_response_s")

    @property
    def tagged(self) -> bool:
        """Whether the file holds the bin index of each photon rather than histograms."""
        return isinstance(self._histograms, TaggedHistograms)

    @property
    def expectation(self) -> bool:
        """Whether the counts are a rendered or processed signal rather than photons."""
        counts = self._file["transients"].get("counts")
        return counts is not None and plain(counts.attrs.get("kind")) == "expectation"

    @property
    def live_time_s(self) -> NDArray[np.float32]:
        """(P,) measurement time of each position; NaN where unknown."""
        if "live_time_s" not in self._file["transients"]:
            return np.full(self.positions, np.nan, np.float32)
        with reading(self.path):
            return self._file["transients/live_time_s"][()].astype(np.float32)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def capture(self) -> Capture:
        """Return the measured positions in rectified time; valid while the file is open.

        Raises
        ------
        DataFileError
            If no position was measured.
        """
        done = self.done
        if not done.any():
            raise DataFileError(
                f"{self.path} holds no measured position: the scan ended before the first; resume it"
            )
        first_bin_s = np.array([self.first_bin_s])
        if self.delay_s is not None:
            first_bin_s = self.first_bin_s - self.delay_s[done]
        elif self.legs is not None:
            first_bin_s = self.first_bin_s - self.legs.delay_s(self.laser_m, self.detector_m)[done]
        return Capture(
            histograms=self._histograms,
            bin_width_s=self.bin_width_s,
            first_bin_s=first_bin_s,
            laser_m=self.laser_m[done],
            detector_m=self.detector_m if len(self.detector_m) == 1 else self.detector_m[done],
        )

    def __str__(self) -> str:
        """Return what a person wants to know at a glance, as aligned lines."""
        lines = summarise(self).items()
        return "\n".join([str(self.path), *(f"  {label:<12} {text}" for label, text in lines)])

    def close(self) -> None:
        """Close the file; histograms can no longer be read."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _time(self, name: str) -> float | None:
        value = self._attribute("transients", name, None)
        return None if value is None else float(value)

    def _json(self, group: str, name: str, default: str) -> Any:
        try:
            return json.loads(self._attribute(group, name, default))
        except ValueError as error:
            raise DataFileError(f"{self.path}: /{group}@{name} is not JSON: {error}") from None

    def _attribute(self, group: str, name: str, default: Any) -> Any:
        with reading(self.path):
            owner: h5py.Group | None = self._file.get(group)
            return default if owner is None else plain(owner.attrs.get(name, default))
