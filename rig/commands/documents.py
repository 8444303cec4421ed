"""The JSON documents that verbs print with ``--json``: one model for each, and what their keys mean.

This is the one place where they are described. The reference pages and the JSON Schemas are made from these
models, and tests hold what verbs really print against them. Verbs do not import this file.

Keys may be added within a version; a key that goes, or means something else, makes a new `VERSION`.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from rig.image.forecast import OnWorkers
from rig.model.calibrations.kinds import KINDS

#: What ``schema_version`` says.
VERSION = 1


class Part(BaseModel):
    """A part of a document: all of its keys are named here."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True)


class Document(Part):
    """A document on stdout."""

    schema_version: Literal[1]
    """The version of the document's keys."""


class Failure(Document):
    """What every verb prints instead of its document when it fails."""

    error: str
    """What failed, and what to do about it; the same sentences as on stderr."""
    exit_code: int
    """The exit code of the program."""


class Light(Part):
    """What was last known of the laser's light."""

    emitting: bool
    """Whether it emits, as far as could be read back."""
    read_back: str | None
    """Time of that read-back, UTC."""


class Measured(Document):
    """`rig scan` and `rig resume`: how a scan ended."""

    file: str
    """The scan file."""
    status: Literal["complete", "interrupted", "failed"]
    reason: str
    """Why it ended."""
    positions: int
    """Steps that are measured, all frames together."""
    photons: int
    """Photons of the whole scan."""
    live_time_s: float
    """Time in which photons were counted, of the whole scan."""
    photons_now: int
    """Photons of this run only; a resumed scan had some before."""
    took_s: float
    """Duration of this run."""
    laser: Light | None
    """State of the laser; None if no laser was opened."""
    unverified: list[str]
    """Settings by hand that no program can check, as sentences."""
    sentence: str
    """A summary, as in a message at the end of the scan."""


class AlignedPeak(Part):
    """The highest peak of the histogram."""

    time_s: float
    """Time after the sync pulse."""
    width_s: float | None
    """Full width at half maximum."""


class Aligned(Document):
    """`rig align`: what was seen; rates are counts a second, None where nothing was counted for them."""

    rig: str
    simulated: bool
    spots_m: list[tuple[float, float, float]]
    """The spots that were lit."""
    reason: str
    """Why it ended."""
    sync_hz: float
    photons: int
    live_time_s: float
    last_hz: float | None
    """The rate at the end."""
    mean_hz: float | None
    highest_hz: float | None
    channels_hz: dict[str, float | None]
    """The rate of each channel at the end."""
    detections_per_pulse: float | None
    dark_hz: float | None
    """The rate without light."""
    background_hz: float | None
    """The rate outside the peak, within the gate."""
    peak: AlignedPeak | None
    took_s: float
    laser: Light | None
    unverified: list[str]


class Planned(Document):
    """`rig scan --dry-run`: what a scan would do."""

    rig: str
    simulated: bool
    plan: dict[str, Any]
    """The plan, as the scan file keeps it."""
    positions: int
    frames: int
    skipped: int
    """Positions of the grid that are left out around the detector's spot."""
    rounds: list[int]
    """Positions that are measured after each round of a progressive order."""
    exposure_total_s: float
    duration_s: float
    """Estimated duration on hardware, with settling, turning and loading."""
    sweeps: int
    loading_s: float
    """Time in which positions are loaded into the mirror."""
    bytes_in_memory: int
    bytes_on_disk: int
    """Estimated size; counts are compressed."""
    mirror_angle_deg: tuple[float, float]
    """Largest mirror angles that the scan needs, in x and y."""
    mirror_limit_deg: tuple[float, float]
    calibrations: list[str]
    """Kinds of calibrations that would be used."""
    unverified: list[str]


class Presets(Document):
    """`rig scan --preset list`."""

    presets: dict[str, str]
    """Description of each preset, by its name."""


class _Image(Document):
    """An image; the document also has its parameters, as a volume file keeps them."""

    model_config = ConfigDict(extra="allow")

    scan: str
    """The scan file that was imaged."""
    scan_digest: str
    """SHA-256 of the scan file."""
    positions: int
    voxels: tuple[int, int, int]
    """Numbers of voxels along x, y and z."""
    wavelength_reason: str | None = None
    """Reason for this wavelength."""
    warnings: list[str]
    took_s: float


class Imaged(_Image):
    """`rig recon`; it also has the parameters of the image, as the volume file keeps them."""

    volume: str
    """The volume file."""
    picture: str | None = None
    video: str | None = None
    page: str | None = None
    frames: int | None = None
    """Number of moments of a video."""


class Previewed(_Image):
    """`rig recon --preview`: only a picture; it also has the parameters of the image."""

    picture: str
    read_s: float
    """How long reading the scan took; 0 where it was kept from the last preview."""


class Forecast(Document):
    """`rig recon --dry-run`: what an image would need; for some solvers only the voxels."""

    scan: str
    voxels: tuple[int, int, int]
    """Numbers of voxels along x, y and z."""
    cores: int
    images_at_most: int
    """Largest number of images that are made, if there are too few photons for the wavelength that the
    program chose."""
    positions: int | None = None
    frequencies: int | None = None
    """Largest number of frequencies of a depth block."""
    pairs: int | None = None
    """Number of pairs of plane and frequency."""
    by_fft: bool | None = None
    waves_s: float | None = None
    """Time on one core of a usual machine for the waves, then for the record, then for the voxels."""
    record_s: float | None = None
    voxels_s: float | None = None
    spectra_bytes: int | None = None
    memory_bytes: int | None = None
    """Memory of the quickest way."""
    least_bytes: int | None = None
    """The smallest possible limit of memory."""
    processor_s: float | None = None
    """Estimated processor time of one image on this computer."""
    clock_s: float | None = None
    on_workers: OnWorkers | None = None


class BatchImage(Part):
    """An image of a batch; it also has what `rig recon` reports of it, or its error and exit code."""

    model_config = ConfigDict(extra="allow")

    name: str
    status: str
    """``done``, ``kept`` from an earlier run, ``failed``, or ``to do``."""
    took_s: float


class Batch(Document):
    """`rig batch`."""

    folder: str
    """Folder of the results."""
    images: list[BatchImage]


class Rendered(Document):
    """`rig sim render`."""

    file: str
    positions: int
    bins: int
    expected: float
    """Mean number of photons that would be counted, over all positions."""
    took_s: float


class Served(Document):
    """`rig sim serve`, when everything is ready; it also has the address of each device, or None."""

    model_config = ConfigDict(extra="allow")

    log: str | None
    """The file that gets a line for each change."""
    config: str | None
    """The configuration by which the devices are reached."""
    pid: int
    began_unix_s: float
    """When the bench's clock was zero, in seconds since 1970."""


class Version(Document):
    """`rig version`."""

    version: str
    """Version of the program."""


class Watched(Document):
    """`rig watch`, when the page can be reached."""

    file: str
    """The scan file."""
    page: str
    """The page's address, with its token if it has one."""


class Imported(Document):
    """`rig import`."""

    file: str
    layout: str
    """The layout that was recognised."""
    positions: int
    bins: int
    time_origin: Literal["wall", "laser"]
    assumed: list[str]
    """What the file did not contain and was assumed, as sentences."""


class Exported(Document):
    """`rig export`."""

    file: str
    layout: str
    bytes: int


class Counted(Part):
    """The photon statistics of a scan, as Table 1 of the paper has them."""

    file: str
    from_s: float
    """Bins that start earlier, in rectified time, are not counted."""
    positions: int
    bins: int
    """Number of bins of all positions together."""
    photons: float
    per_bin: float
    largest: float
    """Largest count of a bin."""
    per_position: float


class Statistics(Document):
    """`rig stats`."""

    scans: list[Counted]


class Plotted(Document):
    """`rig plot`."""

    picture: str
    files: list[str]


class Pass(Part):
    """A pass of a plan; one of a list of spots has neither columns nor rows."""

    model_config = ConfigDict(extra="allow")

    name: str
    positions: int
    exposure_s: float
    frames: int
    motion: Literal["step", "continuous"]


class KnownCalibration(Part):
    """A calibration that a scan has used."""

    kind: str
    found: str
    """Its result, in words."""
    created: str
    expires: str
    age_days: float
    """Its age at the time of the scan."""
    was_good: bool
    """Whether it was valid then."""
    rig: str
    simulated: bool


class ScanTold(Part):
    """What a scan file holds in addition to its photons."""

    kind: Literal["scan"]
    file: str
    created: str | None
    software: str | None
    command: str | None
    """The command that made it."""
    rig: str | None
    simulated: bool
    status: Literal["complete", "interrupted", "failed", "running"]
    reason: str | None
    plan: list[Pass] | None
    positions: int
    """Planned steps."""
    measured: int
    """Steps that are measured."""
    frames: int
    live_time_s: float
    photons: int | None
    """Number of photons; None if they were not added up, or if the file has expectation values."""
    warnings: list[str]
    calibrations: list[KnownCalibration]
    notes: dict[str, str]
    imported: dict[str, Any] | None
    """Where an imported file came from."""


class ScanInfo(Document, ScanTold):
    """`rig info` of a scan."""

    doubts: list[str]
    """Doubts about the file, as sentences."""
    sha256: str | None
    """SHA-256 of the file; None for a scan that is being written."""


class VolumeInfo(Document):
    """`rig info` of a volume."""

    kind: Literal["volume"]
    file: str
    created: str
    software: str
    scan: str
    scan_sha256: str
    voxels: tuple[int, int, int]
    x_m: tuple[float, float]
    """First and last centre of a voxel."""
    y_m: tuple[float, float]
    z_m: tuple[float, float]
    frames: int | None
    """Number of frames; None for an image without a time axis."""
    parameters: dict[str, Any]
    """Parameters with which it was made."""
    command: str | None
    sha256: str


class CalibrationInfo(Document):
    """`rig info` of a calibration."""

    kind: Literal["calibration"]
    calibration: str
    """Its kind."""
    file: str
    found: str
    created: str
    expires: str
    age_days: float
    was_good: bool
    rig: str
    simulated: bool
    devices: dict[str, str]
    """The devices that it belongs to, by their identity."""
    measured_from: list[str]
    warnings: list[str]
    digest: str


class ConfigurationInfo(Document):
    """`rig info` of a configuration."""

    kind: Literal["configuration"]
    file: str
    rig: str
    simulated: bool
    devices: dict[str, str]
    """The kind of each device, by its role."""
    channels: int
    plan: list[Pass]
    notes: dict[str, str]
    sha256: str


class OtherInfo(Document):
    """`rig info` of wall images, of kept records, and of another program's file."""

    model_config = ConfigDict(extra="allow")

    kind: Literal["records", "wall images", "foreign"]
    file: str
    sha256: str


Info = Annotated[
    ScanInfo | VolumeInfo | CalibrationInfo | ConfigurationInfo | OtherInfo, Field(discriminator="kind")
]


class Damaged(Part):
    """A file that cannot be read."""

    file: str
    problem: str


class Listed(Document):
    """`rig list`."""

    folder: str
    scans: list[ScanTold]
    """The scans, the newest last."""
    damaged: list[Damaged]
    sheet: str | None


class Reported(Document):
    """`rig report`."""

    page: str
    scan: str
    volume: str | None
    doubts: list[str]
    """Doubts about the image or the scan, as sentences."""


class Peak(Part):
    """The brightest voxel."""

    x_m: float
    y_m: float
    z_m: float
    intensity: float


class Width(Part):
    """Width of the brightest point along an axis; None if the point reaches beyond the volume."""

    peak_m: float | None
    fwhm_m: float | None
    first_minimum_m: float | None
    theory: dict[str, float]
    """Width by the theory of diffraction, if wavelength and aperture are known."""


class Aside(Part):
    """Displacement of the seen shape from the true one; None if it cannot be determined."""

    x_m: float | None
    y_m: float | None


class MeasuredImage(Document):
    """`rig measure`; without a truth there are no overlap, displacement and depth."""

    volume: str
    truth: str | None
    peak: Peak
    widths: dict[str, Width]
    contrast: float | None
    signal_to_noise: float | None
    background_margin_m: float
    threshold: float | None
    falloff: float
    """Power of depth that intensity is multiplied by, except for the widths."""
    pixels_seen: int
    overlap: float | None = None
    """Intersection over union of the seen and the true shape."""
    displacement: Aside | None = None
    depth: dict[str, float | int | None] | None = None
    """Errors of depth over the pixels that belong to both shapes."""


class Method(Part):
    """One method's part of a comparison; its costs and measures where it applies."""

    model_config = ConfigDict(extra="allow")

    method: str
    applies: bool
    reason: str | None = None
    """Reason why it does not apply."""
    approximate: bool | None = None
    """Whether the data had to be converted for it."""
    notes: list[str] | None = None


class ComparedCapture(Part):
    """A capture by all methods."""

    file: str
    sheet: str
    truth: str | None
    positions: int
    wavelength_m: float
    wavelength_reason: str
    cycles: float
    low_pass_fwhm_s: float
    """Width of the pulse with which the record of all methods except the phasor field is convolved."""
    voxels: tuple[int, int, int]
    depth_m: tuple[float, float]
    methods: list[Method]


class Compared(Document):
    """`rig compare`."""

    comparisons: list[ComparedCapture]


class Finding(Part):
    """The result of one check."""

    check: str
    """Name of the check."""
    what: str
    """What was checked."""
    verdict: Literal["ok", "warning", "missing", "optional"]
    found: str
    """What was found."""
    remedy: str
    """What to do; empty if nothing must be done."""


class Examined(Document):
    """`rig doctor`."""

    headline: str
    """The result in one line."""
    missing: int
    """Number of missing things that this rig needs."""
    warnings: int
    findings: list[Finding]


class Connected(Part):
    """Something that is connected."""

    address: str
    said: str
    """Its identity, as it reports it."""
    way: Literal["serial", "usb", "daq", "library"]
    guess: tuple[str, str] | None
    """Role and kind that it may have."""


class Initialised(Document):
    """`rig init`: the configuration that was written."""

    file: str
    name: str
    simulated: bool
    refused: str
    """Why a dry run refuses this rig; empty if it does not."""
    found: list[Connected]


class ConfigValue(Part):
    """A value of a configuration."""

    key: str
    """Name of the key, with its section."""
    text: str
    """The value as TOML; empty if it is not set."""
    origin: str
    """The file that sets it, or `default`."""


class ConfigShown(Document):
    """`rig config show`."""

    name: str
    values: list[ConfigValue]


class Guard(Part):
    """A process that owns a laser's light."""

    rig: str
    laser: str
    guard: int
    """Number of its process."""


class Trip(Part):
    """Light that was lost, which no person has acknowledged yet."""

    rig: str
    when: str
    reason: str


class LightStatus(Document):
    """`rig laser status`."""

    guards: list[Guard]
    trips: list[Trip]


class Darkened(Part):
    """A laser that had to be switched off."""

    rig: str
    laser: str
    dark: bool
    """Whether the laser itself reported twice that it is dark."""


class LightOff(Document):
    """`rig laser off`."""

    lasers: list[Darkened]


class Asked(Part):
    """A device and how many questions it answered."""

    device: str
    kind: str
    asked: int
    answered: int
    failure: str


class Fact(Part):
    """Result of checking a fact about a device."""

    fact: str
    device: str
    kind: str
    believed: str
    settled_by: str
    """The question that decides it."""
    verdict: Literal["confirmed", "contradicted", "not seen"]
    came: str
    """What the device answered."""


class Probed(Document):
    """`rig devices probe`."""

    folder: str
    simulated: bool
    devices: list[Asked]
    facts: list[Fact]


class StoredCalibration(Part):
    """The newest calibration of a kind."""

    file: str
    created: str
    expires: str
    valid: bool
    devices: dict[str, str]
    software: str
    simulated: bool
    found: str


class Calibrations(Document):
    """`rig calibrate show`; None for kinds that were never measured."""

    folder: str
    calibrations: dict[str, StoredCalibration | None]


class Calibrated(Document):
    """`rig calibrate KIND`."""

    file: str
    picture: str
    calibration: dict[str, Any]
    """The calibration, as its file has it."""


class CalibratedKind(Part):
    """One of the kinds that `rig calibrate all` has measured."""

    file: str
    picture: str
    found: str


class CalibratedAll(Document):
    """`rig calibrate all`: a key for each kind that was measured."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, CalibratedKind]


#: What each verb prints with ``--json``, by its words; any of them prints a `Failure` when it fails.
DOCUMENTS: dict[str, Any] = {
    "scan": Measured | Planned | Presets,
    "resume": Measured,
    "align": Aligned,
    "recon": Imaged | Previewed | Forecast,
    "batch": Batch,
    "import": Imported,
    "export": Exported,
    "info": Info,
    "list": Listed,
    "report": Reported,
    "stats": Statistics,
    "plot": Plotted,
    "measure": MeasuredImage,
    "compare": Compared,
    "init": Initialised,
    "config show": ConfigShown,
    "doctor": Examined,
    "devices probe": Probed,
    "laser off": LightOff,
    "laser status": LightStatus,
    "sim render": Rendered,
    "sim serve": Served,
    "watch": Watched,
    "version": Version,
    "calibrate show": Calibrations,
    "calibrate all": CalibratedAll,
    **{f"calibrate {kind}": Calibrated for kind in KINDS},
}


def schema(verb: str) -> dict[str, Any]:
    """Return the JSON Schema of what a verb prints.

    Raises
    ------
    KeyError
        If there is no such verb, or it prints no document.
    """
    found = TypeAdapter(DOCUMENTS[verb] | Failure).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"rig {verb} --json", **found}
