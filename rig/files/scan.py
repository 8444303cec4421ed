"""Reading a scan file."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import isnan, prod

import h5py
import numpy as np
from numpy.typing import NDArray

from recon.capture import Capture, Histograms
from recon.exhaustive import Exhaustive
from rig.errors import DataFileError, in_shell
from rig.files import forms, mend
from rig.files.blocks import read, spans
from rig.files.check import plain, reading
from rig.files.description import MOST_BINS, Settings, most_pairs, rectified_by_s
from rig.files.histograms import DenseHistograms, LaserHistograms, RepeatedHistograms, TaggedHistograms
from rig.files.journal import Journal, journal_of
from rig.files.outline import ScanOutline, why_mended
from rig.model.config import RigConfig
from rig.model.delays import PathDelays
from rig.model.plan import Pass
from rig.model.quantities import show, show_duration, show_length
from rig.model.state import Channel

#: Photons read at once when all are looked through.
PHOTONS_AT_ONCE = 2**22
#: The writer packs bins without a photon 228:1, deflate's quickest level at its best. Counts of more bytes
#: than these that are packed far more would cost minutes and hold nothing.
UNPACKED_BYTES, MOST_PACKED = 2**28, 512


@dataclass(frozen=True)
class ScanPass:
    """One pass of a scan: steps that were measured with the same settings.

    Attributes
    ----------
    scan
        The file, which must stay open.
    asked
        The pass of the plan; None where the file has no plan.
    steps
        Which steps of the file it is.
    devices
        What the devices said before it, by name.
    """

    scan: "ScanFile"
    asked: Pass | None
    steps: range
    devices: Mapping[str, Settings]

    @property
    def label(self) -> str:
        """File and pass, for messages."""
        alone = len(self.steps) == self.scan.steps
        return str(self.scan.path) if alone or self.asked is None else f"{self.scan.path} ({self.asked.name})"

    @property
    def config(self) -> RigConfig | None:
        """The configuration as it was set for this pass; None where the file does not say."""
        config, asked = self.scan.config, self.asked
        if config is None or asked is None:
            return config
        changes: dict[str, float] = {}
        if asked.gate_s is not None:
            changes |= {"gate_delay_s": asked.gate_s[0], "gate_width_s": asked.gate_s[1]}
        if asked.hold_off_s is not None:
            changes["hold_off_s"] = asked.hold_off_s
        return config.model_copy(update={"detector": config.detector.model_copy(update=changes)})

    @property
    def time_axis(self) -> tuple[int, float, float]:
        """Number and width of the bins, and the left edge of the first, in the file's time."""
        return self.scan.bins, self.scan.bin_width_s, self.scan.first_bin_s

    @property
    def counts(self) -> NDArray:
        """(steps, channels, bins) counts, read now; for the few steps of a calibration."""
        return self.scan.counts(self.steps)

    @property
    def live_time_s(self) -> NDArray[np.float64]:
        """(steps,) measurement time of each step."""
        return self.scan.live_time_s[self.steps.start : self.steps.stop].astype(np.float64)

    @property
    def laser_m(self) -> NDArray[np.float64]:
        """(steps, 3) laser spots."""
        return self.scan.laser_m[self.steps.start : self.steps.stop]


class ScanFile(ScanOutline):
    """A scan file, checked against its layout when it is opened; use as a context manager.

    Attributes
    ----------
    path
        Where it is.
    version
        Of its layout.
    steps, bins
        Steps planned S, and bins B.
    laser_m, detector_m
        (S, 3) and (1 or S, C, 3) spots on the wall; C channels.
    channels
        The detector's pixels.
    bin_width_s, first_bin_s
        The time axis, in the file's time.
    delays, delay_s
        What to subtract for rectified time: the path delays, or a measured (S, C) delay; both None where the
        file is rectified.
    growing
        Whether a scan writes it: what was on disk when it was opened is here.
    mended
        What was done to read the file in spite of its program's end, in words; empty if nothing.

    Raises
    ------
    DataFileError
        If the file is missing, truncated, foreign, or lacks what is needed.
    """

    def _open_mended(self, journal: Journal) -> h5py.File:
        self.mended = why_mended(self.path, journal)
        return mend.for_reading(journal, self.path)

    def _read(self) -> None:
        super()._read()
        self._read_geometry()
        self._read_time()
        self._read_channels()
        self._read_photons(self._sizes)

    def _read_geometry(self) -> None:
        geometry = self._file["geometry"]
        self.laser_m: NDArray[np.float64] = read(geometry["laser_m"]).astype(float)
        self.detector_m: NDArray[np.float64] = read(geometry["detector_m"]).astype(float)
        if self.version == 1:
            self.detector_m = self.detector_m[:, None]
        self.steps = len(self.laser_m)
        if not (np.isfinite(self.laser_m).all() and np.isfinite(self.detector_m).all()):
            raise DataFileError(
                f"{self.path} has a position that is not a number in /geometry; it cannot be used"
            )
        if self.steps == 0 or self.detector_m.shape[1] == 0:
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
        self.delays: PathDelays | None = None
        self.delay_s: NDArray[np.float64] | None = None
        if self.time_origin == "laser" and "delay_s" in self._file["geometry"]:
            self.delay_s = read(self._file["geometry/delay_s"]).astype(float).reshape(self.steps, -1)
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
            self.delays = PathDelays(
                laser_head_m.astype(float), detector_head_m.astype(float), float(delay_s)
            )

    def _read_channels(self) -> None:
        group = self._file.get("channels", {})
        count = self.detector_m.shape[1]
        names = (
            group["name"].asstr()[()].tolist() if "name" in group else ["spad", *map(str, range(1, count))]
        )
        inputs = read(group["input"]).tolist() if "input" in group else list(range(count))
        delay_s, response_s, dark_hz = (
            _known(read(group[name]).astype(float)) if name in group else [None] * count
            for name in ("delay_s", "response_s", "dark_hz")
        )
        self.channels = tuple(
            Channel(
                name=str(names[number]),
                input=int(inputs[number]),
                spot_m=tuple(self.detector_m[0, number].tolist()),
                delay_s=delay_s[number] or 0.0,
                response_s=response_s[number],
                dark_hz=dark_hz[number],
            )
            for number in range(count)
        )

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
        if dense:
            self.bins = sizes["bins"]
            counts = transients["counts"]
            if counts.dtype.kind == "f" and plain(counts.attrs.get("kind")) != "expectation":
                raise DataFileError(
                    f"{self.path}: /transients/counts has type {counts.dtype}; photon counts are "
                    "unsigned integers. Set its attribute kind to 'expectation' if it is a rendered or "
                    "processed signal"
                )
            self._check_stored(counts, int(np.count_nonzero(self.marked)) * prod(counts.shape[1:]))
        else:
            photons = transients["photons"]
            self._spans = self._read_offsets(photons)
            self._check_stored(photons, int((self._spans[1] - self._spans[0]).sum()))
            self.bins = self._tagged_bins(photons)
        if self.bins < 1:
            raise DataFileError(f"{self.path} has {self.bins} bins; at least one is needed")
        pairs = self.steps * self.detector_m.shape[1]
        most = most_pairs(tagged=not dense)
        if self.bins > MOST_BINS or pairs > most:
            raise DataFileError(
                f"{self.path} claims {pairs} pairs of step and channel with {self.bins} bins each; at most "
                f"{most} and {MOST_BINS} are read: divide the scan"
            )

    def _check_stored(self, values: h5py.Dataset, measured: int) -> None:
        """Refuse values that claim to be measured and were never written, or are packed as none are."""
        if values.chunks is None:
            return
        what = values.name.rsplit("/", 1)[-1]
        itemsize = values.dtype.itemsize
        written = values.id.get_num_chunks() * prod(values.chunks) * itemsize
        packed = values.id.get_storage_size()
        if written < measured * itemsize:
            raise DataFileError(
                f"{self.path} says that {measured * itemsize} bytes of {what} were measured, but chunks of "
                f"{written} bytes were written; it is damaged: copy it again, or measure again"
            )
        if written > UNPACKED_BYTES and written > MOST_PACKED * packed:
            raise DataFileError(
                f"{self.path}: its {what} claim {written / 1e9:.3g} GB and are compressed into "
                f"{packed / 1e6:.3g} MB, more than {MOST_PACKED}:1, which is impossible for measurements. "
                "Compress them less: h5repack -f GZIP=1"
            )

    def _read_offsets(self, photons: h5py.Dataset) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the first photon of each pair of step and channel, and the one after its last.

        What is said of steps that are not measured is not looked at: it may be anything while a file is
        written. They have no photons.
        """
        offset = read(self._file["transients/photon_offset"]).astype(np.int64)
        done = np.repeat(self.done, len(self.detector_m[0]))
        first, stop = offset[:-1] * done, offset[1:] * done
        edges = np.column_stack([first, stop])[done].ravel()
        all_of_it = offset[0] == 0 and offset[-1] == len(photons)
        rising = (np.diff(edges, prepend=0, append=len(photons)) >= 0).all()
        if not rising or (done.all() and not all_of_it):
            raise DataFileError(
                f"{self.path}: /transients/photon_offset must rise from 0 to the {len(photons)} photons; "
                f"it goes from {offset[0]} to {offset[-1]}"
            )
        return first, stop

    def _tagged_bins(self, photons: h5py.Dataset) -> int:
        """Return the number of bins of the time-tagged form: as said, or else up to the last photon."""
        for owner in (self._file["transients"], photons):
            if "bins" in owner.attrs:
                return int(plain(owner.attrs["bins"]))
        parts = spans(photons, 0, PHOTONS_AT_ONCE * photons.dtype.itemsize)
        return 1 + max((int(read(photons, part).max()) for part in parts), default=0)

    @cached_property
    def done(self) -> NDArray[np.bool_]:
        """(S,) which steps were measured, and are as they were written."""
        return self.marked & ~self.altered

    @cached_property
    def altered(self) -> NDArray[np.bool_]:
        """(S,) which steps were measured, but were altered in the file since; all False without checksums."""
        with reading(self.path):
            if "checksum" not in self._file["transients"] or not forms.written_here(self._file):
                return np.zeros(self.steps, bool)
            form = forms.of_file(self._file)
            return form.altered(self._file, form.stored_sums(self._file))

    @property
    def doubts(self) -> list[str]:
        """What a person must know who reads it now: if it was mended, lacks its journal, or was altered."""
        found = [self.mended] if self.mended else []
        if self._lacks_journal:
            found.append(
                f"{self.path} was not closed by the program that wrote it, and {journal_of(self.path).name} "
                "is not in the same folder: the last positions of the scan may be missing here. If the file "
                "was renamed or copied, put its journal there under that name; "
                f"{in_shell('rig', 'resume', self.path)} measures what is missing"
            )
        if self.altered.any():
            found.append(
                f"{self.path}: positions {in_words(np.flatnonzero(self.altered))} changed after they were "
                f"written, and are left out. {in_shell('rig', 'resume', self.path)} measures them again"
            )
        return found

    @property
    def _lacks_journal(self) -> bool:
        """Whether nothing closed it, and it has no journal; programs that write no checksums wrote none."""
        return not (self.mended or self.closed or self.growing) and "checksum" in self._file["transients"]

    def passes(self) -> list[ScanPass]:
        """Return the passes of the plan; a file without a plan is one.

        Raises
        ------
        DataFileError
            If the plan is damaged, or does not fit the steps.
        """
        if self.plan is None:
            return [ScanPass(self, None, range(self.steps), self.devices)]
        if len(self.plan) != self.steps:
            raise DataFileError(
                f"{self.path}: its plan has {len(self.plan)} steps, the file {self.steps}; it is damaged"
            )
        return [
            ScanPass(self, one, self.plan.range_of_pass(number), self._devices_of_pass(number))
            for number, one in enumerate(self.plan.passes)
        ]

    def _devices_of_pass(self, number: int) -> dict[str, Settings]:
        with reading(self.path):
            said = self._file.get(f"passes/{number}")
            if said is None:
                return self.devices
            return {name: json.loads(value) for name, value in said.attrs.items() if name != "description"}

    def count(self) -> float:
        """Return the sum of all counts; where no closing record has it, those of measured steps are added."""
        return self.photons if self.closed else float(np.nansum(self.photons_of_steps()))

    def photons_of_steps(self) -> NDArray[np.float64]:
        """Return (S,) the sum of the counts of each step, NaN where it was not measured; all bins are read.

        Raises
        ------
        DataFileError
            If the file is damaged.
        """
        found, steps = np.full(self.steps, np.nan), np.flatnonzero(self.done)
        if self.tagged:
            pairs = self._spans[1] - self._spans[0]
            found[steps] = pairs.reshape(self.steps, len(self.channels)).sum(axis=1)[steps]
            return found
        with reading(self.path):
            sums = np.zeros(len(steps) * len(self.channels))
            for rows, counts in self._histograms(self.done).blocks():
                sums[rows] = counts.sum(axis=1, dtype=float)
        found[steps] = sums.reshape(len(steps), len(self.channels)).sum(axis=1)
        return found

    def counts(self, steps: range) -> NDArray:
        """Return (len(steps), channels, bins) counts of a few steps in a row, measured or not."""
        with reading(self.path):
            if not self.tagged:
                counts = read(self._file["transients/counts"], slice(steps.start, steps.stop))
                return np.asarray(counts.reshape(len(steps), len(self.channels), self.bins))
        wanted = np.zeros(self.steps, bool)
        wanted[steps.start : steps.stop] = True
        blocks = [block for _, block in self._histograms(wanted).blocks()]
        return np.concatenate(blocks).reshape(len(steps), len(self.channels), self.bins)

    @property
    def mirror_rad(self) -> NDArray[np.float64] | None:
        """(S, 2) commanded mirror angles; None where the file does not say."""
        with reading(self.path):
            angles = self._file.get("geometry/mirror_rad")
            return None if angles is None else read(angles).astype(float)

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

    def capture(self) -> Capture:
        """Return what was measured in rectified time, as pairs of laser and detector spot.

        This is where steps and channels become pairs: the channels of a step follow one another, and frames
        are added up. It is valid while the file is open.

        Raises
        ------
        DataFileError
            If nothing was measured, or the passes differ in their settings.
        """
        steps, histograms = self.imaged
        first_bin_s = np.array([self.first_bin_s])
        if self.time_origin == "laser":
            first_bin_s = self.first_bin_s - self.rectified_by_s()[steps].ravel()
        laser_m, detector_m = self.laser_m[steps], self.detector_m
        count = len(self.channels)
        if len(detector_m) > 1:
            detector_m = detector_m[steps].reshape(-1, 3)
        else:
            detector_m = detector_m[0] if count == 1 else np.tile(detector_m[0], (len(steps), 1))
        return Capture(
            histograms=histograms,
            bin_width_s=self.bin_width_s,
            first_bin_s=first_bin_s,
            laser_m=np.repeat(laser_m, count, axis=0),
            detector_m=detector_m,
        )

    def exhaustive(self) -> Exhaustive | None:
        """Return a scan of many lasers by many pixels in rectified time, read laser by laser.

        None where it is no such scan: of one frame, histograms, and pixels that are a finer aperture than the
        lasers, or as fine. Any scan is a `capture`. It is valid while the file is open.

        Raises
        ------
        DataFileError
            If nothing was measured, or the passes differ in their settings.
        """
        if self.tagged or self.frames > 1 or len(self.detector_m) > 1 or self.version == 1:
            return None
        steps, _ = self.imaged
        if not 1 < len(steps) <= len(self.channels):
            return None
        first_bin_s = np.full((1, 1), self.first_bin_s)
        if self.time_origin == "laser":
            first_bin_s = self.first_bin_s - self.rectified_by_s()[steps]
        return Exhaustive(
            LaserHistograms(self.path, self._file["transients/counts"], steps),
            self.bin_width_s,
            first_bin_s,
            self.laser_m[steps],
            self.detector_m[0],
        )

    @property
    def whole_frames(self) -> NDArray[np.int64]:
        """(n,) frames of which every step was measured; of a plan with one set of positions."""
        return np.flatnonzero(self.done.reshape(self.frames, -1).all(axis=1))

    @property
    def imaged(self) -> tuple[NDArray[np.int64], Histograms]:
        """(n,) steps whose spots are imaged (of frames those of the first), and the counts there.

        Raises as `capture`.
        """
        done = np.flatnonzero(self.done)
        if not len(done):
            raise DataFileError(
                f"{self.path} holds no measured position yet: a scan writes it, "
                "and has not finished a line yet"
                if self.growing
                else f"{self.path} holds no measured position: the scan ended before the first; resume it"
            )
        passes = self.plan.passes if self.plan and len(self.plan) == self.steps else ()
        if not all(one.same_settings(passes[0]) and one.positions == passes[0].positions for one in passes):
            raise DataFileError(
                f"{self.path} holds {len(passes)} passes that differ in settings or positions, "
                "so they do not form one image. It is raw data of a calibration"
            )
        frames = self.frames
        size = self.steps // frames
        whole = len(self.whole_frames) if frames > 1 else 0
        first = done if frames == 1 else done[done < size]
        steps = first if whole < 2 else np.arange(size)
        return steps, self.histograms_of(steps)

    def histograms_of(self, steps: NDArray[np.int64]) -> Histograms:
        """Return the counts of some of the steps that are `imaged`, in rising order; frames are added up."""
        frames = self.whole_frames.tolist() if self.frames > 1 else []
        if len(frames) < 2:
            return self._histograms(np.isin(np.arange(self.steps), steps))
        size = self.steps // self.frames
        where = [np.isin(np.arange(self.steps), frame * size + steps) for frame in frames]
        return RepeatedHistograms([self._histograms(wanted) for wanted in where])

    def histograms_of_frames(self) -> list[Histograms]:
        """Return the counts of each whole frame, in order; of a plan with one set of positions."""
        each = np.arange(self.steps) // (self.steps // self.frames)
        return [self._histograms(each == frame) for frame in self.whole_frames.tolist()]

    def _histograms(self, wanted: NDArray[np.bool_]) -> Histograms:
        """Return the counts of (S,) wanted steps."""
        transients = self._file["transients"]
        if not self.tagged:
            return DenseHistograms(self.path, transients["counts"], np.flatnonzero(wanted))
        pairs = np.repeat(wanted, len(self.channels))
        return TaggedHistograms(self.path, transients["photons"], self._spans, self.bins, pairs)

    def rectified_by_s(
        self, delays: PathDelays | None = None, laser_m: NDArray | None = None
    ) -> NDArray[np.float64]:
        """Return (S, C) what to subtract from the file's time for rectified time.

        Parameters
        ----------
        delays, laser_m
            Path delays and (S, 3) spots in place of the file's own.
        """
        if delays is None and self.delay_s is not None:
            return self.delay_s
        delays = delays or self.delays
        if delays is None:
            return np.zeros((self.steps, len(self.channels)))
        laser_m = self.laser_m if laser_m is None else laser_m
        return rectified_by_s(delays, self.channels, laser_m, self.detector_m)

    def __str__(self) -> str:
        """Return what a person wants to know at a glance, as aligned lines."""
        lines = self.summary().items()
        return "\n".join([str(self.path), *(f"  {label:<12} {text}" for label, text in lines)])

    def summary(self) -> dict[str, str]:
        """Return what a person wants to know at a glance, label by label."""
        return _summary(self)

    def _time(self, name: str) -> float | None:
        value = self._attribute("transients", name, None)
        return None if value is None else float(value)


def in_words(numbers: NDArray[np.int64]) -> str:
    """Return rising numbers as ranges, e.g. ``3 to 7, 9``."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs if len(run))


def _known(values: NDArray[np.float64]) -> list[float | None]:
    return [None if isnan(value) else value for value in values.tolist()]


def _summary(scan: ScanFile) -> dict[str, str]:
    """Return what a person wants to know at a glance, label by label."""
    low, high = scan.laser_m.min(axis=0), scan.laser_m.max(axis=0)
    measured = int(np.count_nonzero(scan.done))
    last_s = scan.first_bin_s + scan.bins * scan.bin_width_s
    kind = "time-tagged photons" if scan.tagged else "histograms"
    lines = {
        "status": scan.status + (f" ({scan.reason})" if scan.reason else ""),
        **({"rig": scan.config.name} if scan.config else {}),
        **({"plan": scan.plan.in_words()} if scan.plan else {}),
        "positions": f"{scan.steps:,}"
        + (f", {scan.frames} frames" if scan.frames > 1 else "")
        + ("" if measured == scan.steps else f", {measured:,} measured"),
        "wall": f"{show_length(high[0] - low[0])} x {show_length(high[1] - low[1])}",
        "detector": ("one spot" if len(scan.detector_m) == 1 else "a spot for each position")
        if len(scan.channels) == 1
        else f"{len(scan.channels)} channels",
        "bins": f"{scan.bins:,} of {show(scan.bin_width_s, 's', 4)}, from {show(scan.first_bin_s, 's', 4)} "
        f"to {show(last_s, 's', 4)}",
        "time origin": "pulse on the wall" if scan.time_origin == "wall" else "pulse leaves the laser",
        "content": "expectation values" if scan.expectation else kind,
    }
    live_s = float(np.nansum(scan.live_time_s))
    if live_s > 0:
        lines["exposure"] = (
            f"{show(live_s / max(1, measured), 's')} a position, {show_duration(live_s)} in all"
        )
    if not scan.expectation:
        lines["photons"] = f"{scan.count():,.0f}"
    if source := _source(scan):
        lines["source"] = source
    if scan.created:
        lines["created"] = f"{scan.created} by {scan.software or 'an unnamed program'}"
    lines |= scan.notes
    if told := [*scan.doubts, *scan.warnings]:
        lines["warnings"] = "; ".join(told)
    return lines


def _source(scan: ScanFile) -> str:
    """Say where the photons come from."""
    origin = ["simulated"] if scan.simulated else []
    if scan.imported:
        origin.append(f"imported from {scan.imported.get('file')} ({scan.imported.get('layout')})")
    elif scan.command:
        origin.append(scan.command)
    if scan.estimated:
        origin.append(f"estimated from its data: {'; '.join(scan.estimated)}")
    return ", ".join(origin)
