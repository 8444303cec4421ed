"""The rig's configuration: what is connected, where it stands, and how it is set.

Files are TOML with quantities as text. Without a file the built-in simulated rig is used; it is written out
and commented in ``configs/simulated.toml``.
"""

import re
import tomllib
from collections.abc import Callable
from difflib import get_close_matches
from math import degrees, pi
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError, model_validator
from pydantic_core import ErrorDetails

from rig.errors import ConfigError
from rig.model.presets import Table, merged
from rig.model.quantities import FROM_RECORD, Hertz, Metres, Radians, Seconds, Volts, Watts

#: A file that is larger is no configuration; one with a thousand channels has a tenth of it.
MOST_BYTES = 1_000_000
#: Wrong keys that are told at once.
MOST_TOLD = 20
#: A key of more than 100 words: reading it would take time with the square of their number.
_LONG_KEY = re.compile(r"^[^#=\n]*(?:\.[^.=\n]*){100}", re.MULTILINE)
_UNIT_SUFFIXES = ("_s", "_m", "_hz", "_rad", "_v", "_w")

Point = tuple[Metres, Metres, Metres]


def _key(name: str) -> str:
    """Name a field in a file: without its unit, because there the value carries it."""
    return next((name.removesuffix(s) for s in _UNIT_SUFFIXES if name.endswith(s)), name)


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", alias_generator=_key, populate_by_name=False)


class _GalvoConfig(_Section):
    """What all beam-steering mirrors have."""

    position_m: Point = (-0.15, 0.0, 2.5)
    """The mirror, from which the beam leaves; at rest it sends the beam squarely to the wall."""
    mirrors: Literal[1, 2] = 1
    """1: one mirror that turns about both axes. 2: a galvanometer pair."""
    incidence_rad: Radians = Field(0.0, ge=0, lt=pi / 2)
    """Angle between the beam that comes and the normal of one mirror at rest."""
    incidence_direction_rad: Radians = 0.0
    """Where that beam comes from, turned from x towards y: for one who faces the wall, 0 is from the right,
    90 degrees from above."""
    separation_m: Metres = Field(0.0, ge=0)
    """Distance between the mirrors of a pair."""
    max_angle_x_rad: Radians = Field(0.436332312998582, gt=0)  # 25 degrees
    """Largest optical angle to either side."""
    max_angle_y_rad: Radians = Field(0.349065850398866, gt=0)  # 20 degrees
    """Largest optical angle up or down."""
    beam_dump_rad: tuple[Radians, Radians] | None = None
    """Optical angles of a beam dump, to which the mirror goes when the laser cannot be made dark."""
    settle_timeout_s: Seconds = Field(0.1, gt=0)
    """Longest wait for the mirror to be stable after a move."""


class OptotuneConfig(_GalvoConfig):
    """An Optotune MR-15-30 steering mirror, or another one behind the same electronics."""

    kind: Literal["optotune"] = "optotune"
    address: str | None = None
    """Serial port or pyserial URL."""
    serial: str | None = None
    """The board's serial number, or another part of what it says of itself, when there are several boards."""
    settle_time_s: Seconds = Field(0.006, ge=0)
    """Usual time to settle after a small step; used only to estimate how long a scan takes."""
    turn_time_s: Seconds = Field(0.004, gt=0)
    """Continuous scans: time in which the mirror turns round at the end of a line. At 1 cm a millisecond on a
    wall at 2.5 m, 4 rad/s, 4 ms take 3000 rad/s^2 of optical angle at most (`rig.model.sweep.HARDEST_TURN`).
    The full range of 50 degrees to either side at 20 Hz, which is the mirror's bandwidth for it, takes 13800.
    Much faster lines need longer turns."""
    lag_s: Seconds = Field(0.8e-3, ge=0)
    """Continuous scans: by how much the mirror trails its command; what was calibrated goes before it."""


class AnalogueGalvoConfig(_GalvoConfig):
    """A galvanometer pair that follows two voltages of an NI-DAQmx board, such as Thorlabs GVS012."""

    kind: Literal["analogue"] = "analogue"
    address: str | None = None
    """Socket of a bench that ``rig sim serve`` serves, whose board is used; None: a real one."""
    device: str = Field("Dev1", min_length=1)
    """The board's name in NI MAX; the point clock's, if both shall act together."""
    channels: tuple[str, str] = ("ao0", "ao1")
    """The board's analogue outputs for x and y."""
    volts_per_degree: tuple[float, float] = (0.5, 0.5)
    """Volts for each degree by which a mirror turns, for x and y; the beam turns twice that. Below zero where
    an axis is mounted the other way round."""
    mirrors: Literal[1, 2] = 2
    settle_time_s: Seconds = Field(0.001, ge=0)
    """Time that is waited after a small step; the mirror cannot be asked."""
    settle_time_full_s: Seconds = Field(0.02, ge=0)
    """Time that is waited after a step from one end of the range to the other."""
    turn_time_s: Seconds = Field(0.003, gt=0)
    """Continuous scans: time in which the mirror turns round at the end of a line."""
    lag_s: Seconds = Field(0.13e-3, ge=0)
    """Continuous scans: by how much the mirror trails its command."""

    @model_validator(mode="after")
    def _within_the_range(self) -> "AnalogueGalvoConfig":
        if self.channels[0] == self.channels[1]:
            raise ValueError(f"channels: x and y are both {self.channels[0]}; give each its own")
        for axis, scale in zip("xy", self.volts_per_degree, strict=True):
            volts = degrees(getattr(self, f"max_angle_{axis}_rad") / 2) * abs(scale)
            if not 0 < volts <= 10 * (1 + 1e-9):  # 40 degrees at 0.5 V are just allowed
                raise ValueError(
                    f"max_angle_{axis} is {volts:.3g} V at volts_per_degree {scale:g}, and has to be above "
                    "0 V and up to 10 V. Lower the angle, or give the scale that is set at the servo board"
                )
        return self


class KatanaConfig(_Section):
    """A Onefive/NKT Katana 05, green, whose power has a scale of its own."""

    kind: Literal["katana"] = "katana"
    address: str | None = None
    """Serial port or pyserial URL."""
    power_setpoint: float = Field(0.0, ge=0, le=10)
    """Power setting of the laser's own scale, 0 to 10."""
    max_power_setpoint: float = Field(10.0, ge=0, le=10)
    """The rig's own ceiling of the power setting; a scan with more is refused."""
    repetition_hz: Hertz = Field(10e6, gt=0)
    """Pulses a second."""
    trigger: Literal["internal", "external"] = "internal"
    """What makes the pulses."""

    @model_validator(mode="after")
    def _below_the_ceiling(self) -> "KatanaConfig":
        _require_ceiling("power_setpoint", self.power_setpoint, self.max_power_setpoint)
        return self

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power."""
        return self.power_setpoint / 10

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"power {self.power_setpoint:g} of 10"


class Katana08Config(_Section):
    """A Onefive/NKT Katana 08HP, 775 nm, whose power is in watt."""

    kind: Literal["katana-08hp"] = "katana-08hp"
    address: str | None = None
    """Serial port or pyserial URL."""
    power_w: Watts = Field(0.0, ge=0, le=3.1)
    """Power; published drivers ask for 3.1 W at most."""
    max_power_w: Watts = Field(3.1, ge=0, le=3.1)
    """The rig's own ceiling of the power; a scan with more is refused."""
    repetition_hz: Hertz = Field(18e6, ge=18e6, le=80e6)
    """Pulses a second."""
    trigger: Literal["internal", "level", "ttl"] = "internal"
    """What makes the pulses: the laser, a level at Tr-1, or TTL at Tr-2."""

    @model_validator(mode="after")
    def _below_the_ceiling(self) -> "Katana08Config":
        _require_ceiling("power", self.power_w, self.max_power_w)
        return self

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power."""
        return self.power_w / 3.1

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"power {self.power_w:g} W"


class NktConfig(_Section):
    """An NKT Photonics SuperK laser with a pulse picker, whose level is in percent."""

    kind: Literal["nkt"] = "nkt"
    address: str | None = None
    """Serial port or pyserial URL."""
    level_percent: float = Field(0.0, ge=0, le=100)
    """Level, in percent of full power or current as the laser's mode has it."""
    max_level_percent: float = Field(100.0, ge=0, le=100)
    """The rig's own ceiling of the level; a scan with more is refused."""
    oscillator_hz: Hertz = Field(80e6, gt=0)
    """Pulses a second that come to the pulse picker: the laser's label says it."""
    repetition_hz: Hertz = Field(10e6, gt=0)
    """Pulses a second that leave the pulse picker: the oscillator's by a whole number."""

    @model_validator(mode="after")
    def _possible(self) -> "NktConfig":
        _require_ceiling("level_percent", self.level_percent, self.max_level_percent)
        picked = max(1, round(self.oscillator_hz / self.repetition_hz))
        nearest_hz = self.oscillator_hz / picked
        if abs(nearest_hz - self.repetition_hz) > 1e-3 * self.repetition_hz:
            raise ValueError(
                f"repetition {self.repetition_hz / 1e6:g} MHz is not the oscillator's "
                f"{self.oscillator_hz / 1e6:g} MHz by a whole number; the nearest is "
                f"{nearest_hz / 1e6:.6g} MHz, every {picked}th pulse"
            )
        return self

    @property
    def fraction_of_full(self) -> float:
        """The power as a fraction of the laser's full power."""
        return self.level_percent / 100

    @property
    def power_in_words(self) -> str:
        """The power, for people."""
        return f"level {self.level_percent:g} %"


def _require_ceiling(key: str, asked: float, ceiling: float) -> None:
    if asked > ceiling:
        raise ValueError(f"{key} {asked:g} is above the rig's ceiling max_{key} {ceiling:g}")


class Id120Config(_Section):
    """An ID Quantique ID120, gated."""

    kind: Literal["id120"] = "id120"
    serial: str | None = None
    """Serial number, when several detectors are connected."""
    address: str | None = None
    """Pseudo-terminal of a simulated detector that ``rig sim serve`` serves; None: one on USB."""
    position_m: Point = (0.15, 0.0, 2.5)
    """The detector's lens."""
    gated: bool = True
    """False: free running, the first bounce is detected too."""
    gate_delay_s: Seconds = Field(31.5e-9, ge=0)
    """Opening edge of the gate after the sync pulse."""
    gate_width_s: Seconds = Field(40e-9, gt=0)
    """Time the gate stays open."""
    hold_off_s: Seconds = Field(100e-9, ge=0)
    """Time after a detection during which the detector stays off."""
    excess_bias_v: Volts = Field(5.0, gt=0)
    """Bias above breakdown."""
    max_count_rate_hz: Hertz | None = Field(None, gt=0)
    """Counts a second of a channel at which the bias is taken away; None: half of what is possible."""


class ChannelConfig(_Section):
    """One pixel of the detector: what it looks at, and where its pulses go."""

    name: str = "spad"
    input: int = Field(0, ge=0)
    """Input of the timing instrument, counted from 0."""
    spot_m: Point = (0.0, 0.0, 0.0)
    """The spot on the relay wall that it looks at."""
    delay_s: Seconds = 0.0
    """By how much its pulses come later than timing.electronics_delay says."""


class HydraHarpConfig(_Section):
    """A PicoQuant HydraHarp 400, in histogram mode."""

    kind: Literal["hydraharp"] = "hydraharp"
    library: Path | None = None
    """The vendor's library; by default it is searched for in the usual places."""
    address: str | None = None
    """Socket of a bench that ``rig sim serve`` serves, to simulate the instrument on; None: a real one."""
    serial: str | None = None
    """Serial number, when several instruments are connected."""
    sync_divider: Literal[1, 2, 4, 8, 16] = 1
    sync_level_v: Volts = Field(0.05, ge=0)
    sync_zero_cross_v: Volts = Field(0.01, ge=0)
    input_level_v: Volts = Field(0.05, ge=0)
    """Of every input that a channel uses."""
    input_zero_cross_v: Volts = Field(0.01, ge=0)
    bin_width_s: Seconds = Field(4e-12, gt=0)
    bins: int = Field(15_000, ge=1)
    offset_s: Seconds = Field(28e-9, ge=0)
    """Start of the histogram after the sync pulse, whole nanoseconds."""
    readout_time_s: Seconds = Field(0.005, ge=0)
    """Time to clear, read and restart; used only to estimate how long a scan takes."""


class PlaybackConfig(_Section):
    """A scan file in place of a timing instrument: its counts, step by step, for rehearsals."""

    kind: Literal["playback"] = "playback"
    file: Path
    """The scan file that is played; a relative path begins where the program is called."""
    readout_time_s: Seconds = Field(0.0, ge=0)
    """Time to read a histogram; used only to estimate how long a scan takes."""


Detector = Id120Config


def _kind_or(usual: str) -> Callable[[Any], str]:
    """Return a function that tells a section's kind; one that does not say is of the usual one."""

    def kind(section: Any) -> str:
        found = section.get("kind", usual) if isinstance(section, dict) else getattr(section, "kind", usual)
        return str(found)

    return kind


Galvo = Annotated[
    Annotated[OptotuneConfig, Tag("optotune")] | Annotated[AnalogueGalvoConfig, Tag("analogue")],
    Discriminator(_kind_or("optotune")),
]

Laser = Annotated[
    Annotated[KatanaConfig, Tag("katana")]
    | Annotated[Katana08Config, Tag("katana-08hp")]
    | Annotated[NktConfig, Tag("nkt")],
    Discriminator(_kind_or("katana")),
]

Tcspc = Annotated[
    Annotated[HydraHarpConfig, Tag("hydraharp")] | Annotated[PlaybackConfig, Tag("playback")],
    Discriminator(_kind_or("hydraharp")),
]


class DaqClockConfig(_Section):
    """A point clock: digital outputs of an NI-DAQmx board, which step the mirror and mark the points."""

    kind: Literal["daq"] = "daq"
    address: str | None = None
    """Socket of a bench that ``rig sim serve`` serves, whose board is used; None: a real one."""
    device: str = Field("Dev1", min_length=1)
    """The board's name in NI MAX."""
    markers: tuple[str, ...] = Field(
        ("port0/line0", "port0/line1", "port0/line2", "port0/line3"), min_length=1, max_length=4
    )
    """Lines to the timing instrument's marker inputs M1, M2, M3 and M4: points, lines, frames, a spare."""
    step: str = "port0/line4"
    """Line to the mirror's trigger input; empty where no mirror has one."""
    counter: str = "ctr0"
    """The counter whose pulses are the one clock of all samples."""

    @model_validator(mode="after")
    def _lines_differ(self) -> "DaqClockConfig":
        lines = [*self.markers, self.step]
        twice = sorted({line for line in lines if line and lines.count(line) > 1})
        if twice:
            raise ValueError(f"two pulses go to {twice[0]}; give each a line of its own")
        return self


class TimingConfig(_Section):
    """The time origin."""

    electronics_delay_s: Seconds = 12.3e-9
    """Sync pulse to light leaving the mirror, plus detection to the timing input."""
    instrument_response_s: Seconds = Field(65e-12, gt=0)
    """Full width at half maximum of laser pulse and timing jitter together."""


class ScanConfig(_Section):
    """The scan when the command line does not say otherwise."""

    columns: int = Field(180, ge=2)
    rows: int = Field(130, ge=2)
    spacing_m: Metres = Field(0.01, gt=0)
    row_spacing_m: Metres | None = Field(None, gt=0)
    """Distance between lines, if it is another one: a detector of many pixels sees what is between them."""
    exposure_s: Seconds = Field(0.01, gt=0)
    skip_m: Metres = Field(0.04, ge=0)
    """Side of the square around the detector's spot that is not scanned."""


class CalibrationConfig(_Section):
    """What the rig has learned of itself."""

    folder: Path = Path("calibrations")
    """Where calibrations are kept; a relative path begins where the program is called."""
    use: bool = True
    """Whether scans use them."""


class CamerasConfig(_Section):
    """The cameras that see the relay wall, and the checkerboard by which they are calibrated."""

    addresses: tuple[str, ...] = ()
    """Numbers, device files or URLs of two cameras, as OpenCV opens them."""
    board_columns: int = Field(9, ge=3)
    """Inner corners along the board's columns and rows: one number odd, the other even."""
    board_rows: int = Field(6, ge=3)
    board_square_m: Metres = Field(0.08, gt=0)
    """Side of a square."""
    board_marks_m: tuple[tuple[Metres, Metres], ...] = ((-0.95, -0.2), (-0.32, -0.2), (0.31, -0.2))
    """Marks on the wall for the board's first inner corner; it is held flat on the wall at each of them."""
    board_placed_to_m: Metres = Field(0.2e-3, gt=0)
    """How well either end of the board is held to its mark, standard deviation."""


class MisalignmentConfig(_Section):
    """By how much the simulated rig differs from what the rest of the configuration says of it."""

    wall_tilt_rad: tuple[Radians, Radians] = (0.0, 0.0)
    """The wall, turned about its vertical and its horizontal middle line."""
    galvo_shift_m: Point = (0.0, 0.0, 0.0)
    spad_shift_m: Point = (0.0, 0.0, 0.0)
    mirror_turn_rad: tuple[Radians, Radians, Radians] = (0.0, 0.0, 0.0)
    """The mirror's mount, turned about x, y and z."""
    mirror_offset_rad: tuple[Radians, Radians] = (0.0, 0.0)
    """Optical angles at command zero."""
    mirror_gain: tuple[float, float] = (1.0, 1.0)
    """Real angle for each commanded one."""
    mirror_incidence_rad: tuple[Radians, Radians] = (0.0, 0.0)
    """Angle of incidence on one mirror, and the direction of it."""
    cable_delay_s: Seconds = 0.0
    """Delay of forgotten cable."""
    mirror_lag_s: Seconds | None = Field(None, gt=0)
    """By how much the mirror trails a command that moves evenly; None: as usual for its kind. galvo.lag and
    rig calibrate lag say how much is taken for it."""


class FaultsConfig(_Section):
    """What the simulated detector and timing do wrong; where a number is 0, that effect is off.

    Sources, and what is unconfirmed: ``docs/faults.md``.
    """

    dark_counts_hz: Hertz = Field(10.0, ge=0)
    ambient_light_hz: Hertz = Field(500.0, ge=0)
    """Counts a second from room light while the detector is sensitive."""
    hold_off: bool = True
    """Whether a detection keeps the detector off for detector.hold_off, and the next gate closed."""
    afterpulse_probability: float = Field(0.02, ge=0, le=0.5)
    afterpulse_decay_s: Seconds = Field(40e-9, gt=0)
    gate_ringing: float = Field(0.07, ge=0, le=1)
    """Overshoot of the sensitivity when the gate opens."""
    gate_ringing_decay_s: Seconds = Field(1.5e-9, gt=0)
    memory: float = Field(0.0, ge=0, le=1)
    """Fraction of the gated-off first bounce that comes back inside the gate."""
    memory_decay_s: Seconds = Field(30e-9, gt=0)
    reflections_per_pulse: float = Field(0.0, ge=0)
    """Detections a pulse from each stray reflection of the first bounce."""
    failed_gates: float = Field(0.0, ge=0, le=1)
    """Fraction of positions where the gate does not block the first bounce."""
    failed_gate_radius_m: Metres = Field(0.0, ge=0)
    """Distance from the detector's spot up to which it does not either."""
    dead_time_s: Seconds = Field(80e-9, ge=0)
    """Of the timing instrument."""
    nonlinearity: float = Field(0.0, ge=0, lt=0.02)
    """Differential non-linearity of the timing instrument, root mean square."""
    drift_per_minute_s: Seconds = 0.0
    """How much later counts come with each minute."""
    largest_count: int = Field(2**32 - 1, ge=1, le=2**32 - 1)
    """Where a bin of the timing instrument is full."""
    sync_pulse_v: Volts = Field(0.3, ge=0)
    """Height of the laser's sync pulses; at a higher tcspc.sync_level none is seen."""
    input_pulse_v: Volts = Field(0.3, ge=0)
    """Height of the detector's pulses; at a higher tcspc.input_level none is seen."""
    line_noise_v: Volts = Field(2e-3, ge=0)
    """Noise of both lines, root mean square, which a level near zero counts."""


class MotionConfig(_Section):
    """How the hidden scene moves, all of it together: straight ahead, and back, again and again."""

    travel_m: Point
    """From one end of its way to the other; without motion it stands in the middle."""
    duration_s: Seconds = Field(gt=0)
    """Time from one end to the other; it sets off from the first when the bench's clock begins."""


class SimulationConfig(_Section):
    """The simulated bench, when there is no hardware."""

    scene: str = "letters"
    """Name of a built-in scene, or path of an OBJ, PLY or STL file."""
    bounces: Literal[3, 4, 5] = 3
    """3: wall, hidden surface, wall. 4 and 5 add interreflections."""
    roughness: float | None = Field(None, ge=0.05, le=1)
    """Roughness of all hidden surfaces instead of their own; 1 is Lambertian, less is glossy."""
    gloss: Literal["ward", "ggx"] | None = None
    """Model of the gloss of all hidden surfaces instead of their own."""
    motion: MotionConfig | None = None
    """Present: the scene moves while it is scanned (with three bounces). Absent: it stands still."""
    count_rate_hz: Hertz | None = Field(None, gt=0)
    """Mean detections a second over the scanned wall, to which the light is tuned; None leaves the light."""
    seed: int = Field(0, ge=0)
    real_time: bool = False
    """False: the bench's clock runs as fast as the computer can."""
    faults: FaultsConfig = FaultsConfig()
    misalignment: MisalignmentConfig = MisalignmentConfig()

    @model_validator(mode="after")
    def _moves_without_interreflections(self) -> "SimulationConfig":
        if self.motion is not None and self.bounces > 3:
            raise ValueError(
                f"a scene that moves is lit by three bounces, not {self.bounces}: leave motion or bounces out"
            )
        return self


class RigConfig(_Section):
    """The whole rig. All defaults together are the built-in rig, except for point clock and simulation."""

    name: str = "simulated rig"
    galvo: Galvo = OptotuneConfig()
    laser: Laser = KatanaConfig(power_setpoint=10.0)
    """Without this section, which a real rig has, the simulated laser has full power."""
    detector: Detector = Id120Config()
    tcspc: Tcspc = HydraHarpConfig()
    channels: tuple[ChannelConfig, ...] = (ChannelConfig(),)
    """The detector's pixels, in the order in which a scan file holds them; a single SPAD has one."""
    point_clock: DaqClockConfig | None = None
    """Present: the mirror can be scanned without a stop, with a marker at each point."""
    timing: TimingConfig = TimingConfig()
    scan: ScanConfig = ScanConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    cameras: CamerasConfig = CamerasConfig()
    simulation: SimulationConfig | None = None
    """Present: devices are simulated at their wires. Absent: real devices at their addresses."""

    @model_validator(mode="before")
    @classmethod
    def _from_older(cls, table: Any) -> Any:
        return _with_kinds(table) if isinstance(table, dict) else table

    @model_validator(mode="after")
    def _incidence_is_of_one_mirror(self) -> "RigConfig":
        wrong_rad = self.simulation.misalignment.mirror_incidence_rad if self.simulation else (0.0, 0.0)
        if self.galvo.mirrors == 2 and (self.galvo.incidence_rad or any(wrong_rad)):
            raise ValueError(
                "galvo.incidence (or simulation.misalignment.mirror_incidence) is given for a pair: it is an "
                "angle of one mirror that turns about both axes. Leave it out, or set galvo.mirrors = 1"
            )
        return self

    @model_validator(mode="after")
    def _channels_differ(self) -> "RigConfig":
        if not self.channels:
            raise ValueError("channels: there is none; a single detector has one")
        for what in ("name", "input"):
            values = [getattr(channel, what) for channel in self.channels]
            twice = sorted({value for value in values if values.count(value) > 1})
            if twice:
                raise ValueError(f"channels: two have the {what} {twice[0]}; give each its own")
        return self

    @model_validator(mode="after")
    def _galvo_and_clock_share_a_board(self) -> "RigConfig":
        if isinstance(self.galvo, AnalogueGalvoConfig) and self.point_clock is not None:
            galvo, clock = ((one.device, one.address) for one in (self.galvo, self.point_clock))
            if galvo != clock:
                raise ValueError(
                    f"point_clock.device is {clock[0]}, galvo.device is {galvo[0]}: an analogue galvo and "
                    "its point clock have to be on the same board, which plays both by one clock"
                )
        return self

    @model_validator(mode="after")
    def _addresses_are_given(self) -> "RigConfig":
        if self.simulation is None:
            for name, address in self.serial_addresses.items():
                if address is None:
                    raise ValueError(
                        f"{name}.address is missing: give the serial port, "
                        f'e.g. address = "/dev/ttyACM0", or add a [simulation] section'
                    )
        if self.galvo.position_m[2] <= 0 or self.detector.position_m[2] <= 0:
            raise ValueError(
                "galvo.position and detector.position stand in front of the wall: "
                "their third number is above 0"
            )
        return self

    @property
    def boards(self) -> dict[str, str | None]:
        """The DAQ boards that galvo and point clock are on: their names, and where they are served."""
        users = (self.galvo if isinstance(self.galvo, AnalogueGalvoConfig) else None, self.point_clock)
        return {one.device: one.address for one in users if one is not None}

    @property
    def serial_addresses(self) -> dict[str, str | None]:
        """Where the devices on a serial line are, by their section."""
        galvo = {"galvo": self.galvo.address} if isinstance(self.galvo, OptotuneConfig) else {}
        return {**galvo, "laser": self.laser.address}

    @property
    def simulated(self) -> bool:
        """Whether all devices are simulated in this process, so that nothing outside of it can be harmed."""
        return self.simulation is not None

    @property
    def served(self) -> bool:
        """Whether the photons are those of a simulated bench that another process serves."""
        return isinstance(self.tcspc, HydraHarpConfig) and self.tcspc.address is not None

    @property
    def rehearsed(self) -> bool:
        """Whether the counts say nothing of a real rig: they are simulated, or played from a file."""
        return self.simulated or self.served or self.tcspc.kind == "playback"

    def differences(self, other: "RigConfig") -> list[str]:
        """Return in which settings a scan with ``other`` differs, as ``key is A, was B``.

        Left out is what does not change what is measured: where devices are connected, limits, times to wait,
        cameras, the folder of calibrations, and the plan of a scan.
        """
        mine, theirs = _flat(self.model_dump()), _flat(other.model_dump())
        return [
            f"{key} is {mine.get(key)}, was {theirs.get(key)}"
            for key in sorted(mine.keys() | theirs.keys())
            if mine.get(key) != theirs.get(key) and not key.startswith(_NOT_MEASURED_WITH)
        ]


#: Keys, or beginnings of keys, that may change between two parts of a scan.
_NOT_MEASURED_WITH = (
    "galvo.address",
    "galvo.device",
    "galvo.max_angle",
    "galvo.beam_dump",
    "galvo.settle_",
    "laser.address",
    "laser.max_",
    "detector.max_count_rate",
    "detector.serial",
    "detector.address",
    "tcspc.library",
    "tcspc.serial",
    "tcspc.address",
    "tcspc.readout_time_s",
    "tcspc.file",
    "point_clock",
    "scan.",
    "calibration.",
    "cameras.",
    "simulation.real_time",
)


#: Sections as they were called before their kind was a choice, and keys that have gone to `channels` since.
_OLDER_SECTIONS = {"hydraharp": "tcspc", "spad": "detector"}
_OLDER_KEYS = {
    ("tcspc", "input_channel"): "input",
    ("detector", "spot"): "spot",
    ("detector", "spot_m"): "spot_m",
}


def _with_kinds(table: dict[str, Any]) -> dict[str, Any]:
    """Return a configuration of an older program, as a file or a scan holds it, in the present sections."""
    table = {_OLDER_SECTIONS.get(name, name): value for name, value in table.items()}
    of_channel: dict[str, Any] = {}
    for (section, key), channel_key in _OLDER_KEYS.items():
        values = table.get(section)
        if isinstance(values, dict) and key in values:
            of_channel[channel_key] = values[key]
            table[section] = {name: value for name, value in values.items() if name != key}
    return {**table, "channels": [of_channel]} if of_channel and "channels" not in table else table


def _flat(table: dict[str, Any], within: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys."""
    values: dict[str, Any] = {}
    for name, value in table.items():
        values |= _flat(value, f"{within}{name}.") if isinstance(value, dict) else {within + name: value}
    return values


def built_in() -> RigConfig:
    """Return the built-in simulated rig."""
    return RigConfig(point_clock=DaqClockConfig(), simulation=SimulationConfig())


def recorded(text: str) -> RigConfig:
    """Read the configuration that a scan file holds: JSON with SI numbers, from `RigConfig.model_dump_json`.

    Raises
    ------
    ConfigError
        If it does not fit this version of the program.
    """
    try:
        return RigConfig.model_validate_json(text, context=FROM_RECORD, by_alias=False, by_name=True)
    except ValidationError as error:
        raise ConfigError("; ".join(_explain(problem) for problem in error.errors())) from None


def built_in_with(changes: Table) -> RigConfig:
    """Return the built-in simulated rig with ``changes``, written as a file's tables are.

    Raises
    ------
    ConfigError
        If a value is wrong.
    """
    try:
        return RigConfig.model_validate(merged({"point_clock": {}, "simulation": {}}, changes))
    except ValidationError as error:
        raise ConfigError("; ".join(_explain(problem) for problem in error.errors())) from None


def load(path: Path, changes: Table | None = None) -> RigConfig:
    """Read a configuration file, and make ``changes``, written as a file's tables are, to it.

    Raises
    ------
    ConfigError
        If the file is missing, is not TOML, or has an unknown key or a wrong value; all are named.
    """
    table = _table(path)
    try:
        return RigConfig.model_validate(merged(table, changes or {}))
    except ValidationError as error:
        raise ConfigError(_all_of(error, path)) from None


def _table(path: Path) -> Table:
    """Read a TOML file; raises as `load`."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        text = content.decode("utf-8")
        if len(content) > MOST_BYTES or _LONG_KEY.search(text):
            raise ConfigError(
                f"{path}: is no configuration: one has at most {MOST_BYTES / 1e6:g} MB, and short keys"
            )
        return tomllib.loads(text)
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot be read ({error.strerror}). Give the path of a TOML file"
        ) from None
    except RecursionError:
        raise ConfigError(f"{path}: is no configuration: its values are nested too deeply") from None
    except ValueError as error:  # what TOML forbids, bytes that are no text, numbers of thousands of digits
        raise ConfigError(f"{path}: is not valid TOML: {error}") from None


def _all_of(error: ValidationError, path: Path) -> str:
    """Return what is wrong, a line for each key, the first `MOST_TOLD` of them."""
    told = [f"{path}: {_explain(problem)}" for problem in error.errors()]
    more = [f"{path}: and {len(told) - MOST_TOLD} more"] if len(told) > MOST_TOLD else []
    return "\n".join(told[:MOST_TOLD] + more)


#: Sections of several kinds; pydantic puts the kind into the place of an error.
_KINDS: dict[str, dict[str, type[BaseModel]]] = {
    "galvo": {"optotune": OptotuneConfig, "analogue": AnalogueGalvoConfig},
    "laser": {"katana": KatanaConfig, "katana-08hp": Katana08Config, "nkt": NktConfig},
    "tcspc": {"hydraharp": HydraHarpConfig, "playback": PlaybackConfig},
}


def _explain(problem: ErrorDetails) -> str:
    place = problem["loc"]
    parts = [part for before, part in zip(("", *place), place, strict=False) if not _is_kind(before, part)]
    where = ".".join(str(part) for part in parts)
    if problem["type"] == "extra_forbidden":
        if owners := _kinds_with(place):
            return (
                f"'{where}' is a key of kind {' or '.join(owners)}; this {place[0]} is of kind "
                f"'{place[1]}', which has {', '.join(_known_keys(place[:-1]))}"
            )
        near = get_close_matches(str(place[-1]), _known_keys(place[:-1]), n=1)
        return f"unknown key '{where}'" + (f"; did you mean '{near[0]}'?" if near else "")
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "union_tag_invalid":
        message = f"there is no kind {problem['ctx']['tag']}; choose among {problem['ctx']['expected_tags']}"
    return f"{where}: {message}" if where else message


def _is_kind(section: str | int, part: str | int) -> bool:
    return part in _KINDS.get(str(section), {})


def _kinds_with(place: tuple[str | int, ...]) -> list[str]:
    """Return the other kinds of a section of which a key is, quoted."""
    if len(place) != 3 or not _is_kind(place[0], place[1]):
        return []
    return [f"'{kind}'" for kind in _KINDS[str(place[0])] if place[2] in _known_keys((place[0], kind))]


def _known_keys(place: tuple[str | int, ...]) -> list[str]:
    model: type[BaseModel] = RigConfig
    for before, part in zip(("", *place), place, strict=False):
        if isinstance(part, int):
            continue
        if part in _SECTIONS:
            model = _SECTIONS[part]
        elif _is_kind(before, part):
            model = _KINDS[str(before)][part]
        else:
            model = model.model_fields[part].annotation  # type: ignore[assignment]
    return [field.alias or name for name, field in model.model_fields.items()]


#: Sections whose type is not simply that of their field.
_SECTIONS: dict[str, type[BaseModel]] = {
    "simulation": SimulationConfig,
    "point_clock": DaqClockConfig,
    "motion": MotionConfig,
    "channels": ChannelConfig,
    "galvo": OptotuneConfig,
    "laser": KatanaConfig,
    "tcspc": HydraHarpConfig,
}
