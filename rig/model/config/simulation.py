"""Sections of the simulated bench."""

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from rig.model.config.section import Point, Section
from rig.model.quantities import Hertz, Metres, Radians, Seconds, Volts

#: Endings of mesh files.
MESH_ENDINGS = (".obj", ".ply", ".stl")


class MisalignmentConfig(Section):
    """How much the simulated rig differs from the rest of the configuration."""

    wall_tilt_rad: tuple[Radians, Radians] = (0.0, 0.0)
    """Turn of the wall about its vertical and its horizontal middle line."""
    galvo_shift_m: Point = (0.0, 0.0, 0.0)
    """Shift of the mirror from its configured position."""
    spad_shift_m: Point = (0.0, 0.0, 0.0)
    """Shift of the detector from its configured position."""
    mirror_turn_rad: tuple[Radians, Radians, Radians] = (0.0, 0.0, 0.0)
    """Turn of the mirror's mount about x, y and z."""
    mirror_offset_rad: tuple[Radians, Radians] = (0.0, 0.0)
    """Optical angles at command zero."""
    mirror_gain: tuple[float, float] = (1.0, 1.0)
    """Real angle for each commanded one."""
    mirror_incidence_rad: tuple[Radians, Radians] = (0.0, 0.0)
    """Angle of incidence on one mirror, and its direction."""
    cable_delay_s: Seconds = 0.0
    """Delay of a cable that the configuration does not mention."""
    mirror_lag_s: Seconds | None = Field(None, gt=0)
    """By how much the mirror trails a command that moves evenly; None: the usual value of its kind.
    galvo.lag and rig calibrate lag set the value that scans assume."""


class FaultsConfig(Section):
    """What the simulated detector and timing do wrong; where a number is 0, that effect is off.

    Sources, and what is unconfirmed: ``docs/faults.md``.
    """

    dark_counts_hz: Hertz = Field(10.0, ge=0)
    """Counts a second without any light."""
    ambient_light_hz: Hertz = Field(500.0, ge=0)
    """Counts a second from room light while the detector is sensitive."""
    hold_off: bool = True
    """Whether a detection switches the detector off for detector.hold_off, and keeps the next gate closed."""
    afterpulse_probability: float = Field(0.02, ge=0, le=0.5)
    """Probability that a detection causes another one, an afterpulse."""
    afterpulse_decay_s: Seconds = Field(40e-9, gt=0)
    """Time in which that probability falls to 1/e."""
    gate_ringing: float = Field(0.07, ge=0, le=1)
    """Overshoot of the sensitivity when the gate opens."""
    gate_ringing_decay_s: Seconds = Field(1.5e-9, gt=0)
    """Time in which the overshoot falls to 1/e."""
    memory: float = Field(0.0, ge=0, le=1)
    """Fraction of the gated-off first bounce that comes back inside the gate."""
    memory_decay_s: Seconds = Field(30e-9, gt=0)
    """Time in which it falls to 1/e."""
    reflections_per_pulse: float = Field(0.0, ge=0)
    """Detections a pulse from each stray reflection of the first bounce."""
    failed_gates: float = Field(0.0, ge=0, le=1)
    """Fraction of positions where the gate does not block the first bounce."""
    failed_gate_radius_m: Metres = Field(0.0, ge=0)
    """Up to this distance from the detector's spot it does not block it, either."""
    dead_time_s: Seconds = Field(80e-9, ge=0)
    """Dead time of the timing instrument."""
    nonlinearity: float = Field(0.0, ge=0, lt=0.02)
    """Differential non-linearity of the timing instrument, root mean square."""
    drift_per_minute_s: Seconds = 0.0
    """Drift of all counts to later times, per minute."""
    largest_count: int = Field(2**32 - 1, ge=1, le=2**32 - 1)
    """Number of counts at which a bin of the timing instrument is full."""
    sync_pulse_v: Volts = Field(0.3, ge=0)
    """Depth of the laser's sync pulses, which are negative; a tcspc.sync_level beyond it is not reached."""
    input_pulse_v: Volts = Field(0.3, ge=0)
    """Depth of the detector's pulses, which are negative; a tcspc.input_level beyond it is not reached."""
    line_noise_v: Volts = Field(2e-3, ge=0)
    """Noise of both lines, root mean square, which is counted if the level is near zero."""


class ByHandConfig(Section):
    """What a person has set at the simulated detector, where the program cannot: `detector.kind` ``mpd``."""

    bias: bool = True
    """Whether its bias is on."""
    hold_off_s: Seconds | None = Field(None, ge=0)
    """Its hold-off; None: detector.hold_off."""
    error: int = Field(0, ge=0)
    """The number of the error that it reports; 0: no error."""


class MotionConfig(Section):
    """How the hidden scene moves, all of it together: straight ahead, and back, again and again."""

    travel_m: Point
    """Path from one end to the other; without motion the scene stands in the middle."""
    duration_s: Seconds = Field(gt=0)
    """Time from one end to the other; the motion starts at the first end when the bench's clock starts."""


class SimulationConfig(Section):
    """The simulated bench, when there is no hardware."""

    scene: str = "letters"
    """Name of a built-in scene, or path of an OBJ, PLY or STL file."""
    place_m: Point | None = None
    """Where the middle of a mesh's bounding box is put; None: as in its file."""
    rotate_rad: tuple[Radians, Radians, Radians] = (0.0, 0.0, 0.0)
    """A mesh is turned about x, then y, then z, about that middle."""
    scale: float = Field(1.0, gt=0, le=1e6)
    """Factor for the coordinates of a mesh's file: 0.001 for a file in millimetres."""
    mesh_sha256: str = ""
    """SHA-256 of the mesh's file; another file is refused. Scan files have it, so that a scan is resumed
    with the mesh that it began with."""
    bounces: Literal[3, 4, 5] = 3
    """3: wall, hidden surface, wall. 4 and 5 add interreflections."""
    roughness: float | None = Field(None, ge=0.05, le=1)
    """Roughness of all hidden surfaces instead of their own; 1 is Lambertian, less is glossy."""
    gloss: Literal["ward", "ggx"] | None = None
    """Model of the gloss of all hidden surfaces instead of their own."""
    motion: MotionConfig | None = None
    """Present: the scene moves while it is scanned (with three bounces). Absent: it stands still."""
    count_rate_hz: Hertz | None = Field(None, gt=0)
    """Mean detections a second over the scanned wall, to which the light is adjusted; None: the light is
    not adjusted."""
    seed: int = Field(0, ge=0)
    """Seed of the random numbers; the same seed gives the same photons each time."""
    real_time: bool = False
    """False: the bench's clock runs as fast as the computer can."""
    faults: FaultsConfig = FaultsConfig()
    misalignment: MisalignmentConfig = MisalignmentConfig()
    by_hand: ByHandConfig = ByHandConfig()

    @property
    def mesh(self) -> Path | None:
        """The mesh file that is the scene; None of a built-in scene."""
        path = Path(self.scene)
        return path if path.suffix.lower() in MESH_ENDINGS else None

    @model_validator(mode="after")
    def _places_meshes_alone(self) -> "SimulationConfig":
        placed = self.place_m is not None or any(self.rotate_rad) or self.scale != 1
        if placed and self.mesh is None:
            raise ValueError(
                f"place, rotate and scale are for a mesh file, but the scene '{self.scene}' is built in: "
                f"leave them out, or name an {', '.join(MESH_ENDINGS)} file"
            )
        return self

    @model_validator(mode="after")
    def _moves_without_interreflections(self) -> "SimulationConfig":
        if self.motion is not None and self.bounces > 3:
            raise ValueError(
                f"a scene that moves is simulated with three bounces, not {self.bounces}: "
                "leave motion or bounces out"
            )
        return self
