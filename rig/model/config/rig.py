"""The whole rig."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationInfo, model_validator

from rig.model.config.delayers import DelayerConfig, ExternalDelayerConfig
from rig.model.config.detectors import (
    ChannelConfig,
    DetectorConfig,
    ExternalDetectorConfig,
    MpdConfig,
)
from rig.model.config.galvos import AnalogueGalvoConfig, GalvoConfig, OptotuneConfig
from rig.model.config.harps import HarpConfig, HydraHarpConfig
from rig.model.config.kinds import ROLES
from rig.model.config.lasers import ExternalLaserConfig, KatanaConfig, LaserConfig
from rig.model.config.notify import NotifyConfig
from rig.model.config.older import with_kinds
from rig.model.config.point_clocks import DaqClockConfig, PointClockConfig
from rig.model.config.section import Section
from rig.model.config.shutters import DaqShutterConfig, ShutterConfig
from rig.model.config.simulation import SimulationConfig
from rig.model.config.timing import TcspcConfig, TimingConfig
from rig.model.config.use import CalibrationConfig, CamerasConfig, NotesConfig, ScanConfig
from rig.model.quantities import FROM_RECORD


class RigConfig(Section):
    """The whole rig. Its defaults are the built-in rig, but for delayer, point clock and simulation."""

    name: str = "simulated rig"
    """Name of the rig; its calibrations are found by this name."""
    galvo: Annotated[GalvoConfig, ROLES["galvo"]] = OptotuneConfig()
    laser: Annotated[LaserConfig, ROLES["laser"]] = KatanaConfig(power_setpoint=10.0)
    """A real rig must have this section; without it the simulated laser has full power."""
    detector: Annotated[DetectorConfig, ROLES["detector"]] = MpdConfig()
    delayer: Annotated[DelayerConfig, ROLES["delayer"]] | None = None
    """Present: it opens the detector's gate at detector.gate_delay. Absent: the detector or cables set the
    delay of the gate."""
    tcspc: Annotated[TcspcConfig, ROLES["tcspc"]] = HydraHarpConfig()
    channels: tuple[ChannelConfig, ...] = (ChannelConfig(),)
    """The detector's pixels, in the order in which a scan file holds them; a single SPAD has one."""
    point_clock: Annotated[PointClockConfig, ROLES["point_clock"]] | None = None
    """Present: the mirror can be scanned without a stop, with a marker at each point."""
    shutter: Annotated[ShutterConfig, ROLES["shutter"]] | None = None
    """Present: light leaves only while it is open."""
    timing: TimingConfig = TimingConfig()
    scan: ScanConfig = ScanConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    cameras: CamerasConfig = CamerasConfig()
    notes: NotesConfig = NotesConfig()
    notify: NotifyConfig = Field(NotifyConfig(), exclude=True)
    """Never written to scan files or printed: it may hold secrets."""
    simulation: SimulationConfig | None = None
    """Present: devices are simulated at their wires. Absent: real devices at their addresses."""

    @model_validator(mode="before")
    @classmethod
    def _from_older(cls, table: Any, info: ValidationInfo) -> Any:
        if not isinstance(table, dict):
            return table
        table = with_kinds(table)
        if info.context == FROM_RECORD:
            table.pop("notify", None)  # no program writes it, and none obeys it
            return _with_a_gate_that_exists(table)
        _refuse_gated_id120(table.get("detector"))
        return _with_built_in_delayer(table)

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
        if isinstance(self.galvo, AnalogueGalvoConfig) and isinstance(self.point_clock, DaqClockConfig):
            galvo, clock = ((one.device, one.address) for one in (self.galvo, self.point_clock))
            if galvo != clock:
                raise ValueError(
                    f"point_clock.device is {clock[0]}, galvo.device is {galvo[0]}: an analogue galvo and "
                    "its point clock must be on the same board, which drives both from one clock"
                )
        return self

    @model_validator(mode="after")
    def _addresses_are_given(self) -> "RigConfig":
        if self.simulation is None:
            for name in ROLES:
                section = getattr(self, name)
                if section is not None and section.needs_address and section.address is None:
                    raise ValueError(
                        f"{name}.address is missing: give the serial port, "
                        f'e.g. address = "/dev/ttyACM0", or add a [simulation] section'
                    )
        if self.galvo.position_m[2] <= 0 or self.detector.position_m[2] <= 0:
            raise ValueError(
                "galvo.position and detector.position must be in front of the wall: "
                "their third number must be above 0"
            )
        return self

    @model_validator(mode="after")
    def _shutter_has_a_line_of_its_own(self) -> "RigConfig":
        clock, shutter = self.point_clock, self.shutter
        if isinstance(clock, DaqClockConfig) and isinstance(shutter, DaqShutterConfig):
            taken = (*clock.markers, clock.step)
            if (clock.device, clock.address) == (shutter.device, shutter.address) and shutter.line in taken:
                raise ValueError(
                    f"shutter.line is {shutter.line}, which is also a line of point_clock: "
                    "give it another line"
                )
        return self

    @property
    def light_place(self) -> str:
        """Where the light is switched, for people and for those who look for its guard."""
        if isinstance(self.laser, ExternalLaserConfig):
            return self.shutter.place if self.shutter else f"{self.laser.model} of {self.name}, by hand"
        return str(self.laser.address)

    @property
    def known_dark_by(self) -> str:
        """What speaks for darkness when the light was put out, in words."""
        if not isinstance(self.laser, ExternalLaserConfig):
            return "read back twice"
        return "by its shutter" if self.shutter else "as reported by a person"

    @property
    def unverified(self) -> tuple[str, ...]:
        """What of this rig a person sets and no program can check, as sentences."""
        told = []
        if isinstance(self.laser, ExternalLaserConfig):
            told.append(
                "the laser's own emission and power are not known: the light counts as on while the shutter "
                "is open"
                if self.shutter
                else "the laser is switched by hand, and no program can switch it off: only the sync "
                "pulses show its emission, if they come with the light"
            )
        by_hand = "set by hand and cannot be read back: the file records what a person reported"
        if isinstance(self.detector, ExternalDetectorConfig):
            told.append(f"bias, gate and hold-off of the detector are {by_hand}")
        if isinstance(self.delayer, ExternalDelayerConfig):
            told.append(f"the delay of the gate is {by_hand}")
        return tuple(told)

    @property
    def boards(self) -> dict[str, str | None]:
        """The DAQ boards that devices are on: their names, and where they are served."""
        on_boards = (AnalogueGalvoConfig, DaqClockConfig, DaqShutterConfig)
        users = [one for one in (self.galvo, self.point_clock, self.shutter) if isinstance(one, on_boards)]
        return {one.device: one.address for one in users}

    @property
    def serial_addresses(self) -> dict[str, str | None]:
        """Where the devices on a serial line are, by their section."""
        galvo = {"galvo": self.galvo.address} if isinstance(self.galvo, OptotuneConfig) else {}
        detector = {"detector": self.detector.address} if isinstance(self.detector, MpdConfig) else {}
        others = {"laser": self.laser, "delayer": self.delayer, "shutter": self.shutter}
        on_lines = {
            name: one.address for name, one in others.items() if one is not None and one.needs_address
        }
        return {**galvo, **detector, **on_lines}

    @property
    def gate_hz(self) -> float:
        """How often the gate of a gated detector opens."""
        return self.laser.repetition_hz / (self.delayer.divider if self.delayer else 1)

    @property
    def simulated(self) -> bool:
        """Whether all devices are simulated in this process, so that nothing outside of it can be harmed."""
        return self.simulation is not None

    @property
    def served(self) -> bool:
        """Whether the photons are those of a simulated bench that another process serves."""
        return isinstance(self.tcspc, HarpConfig) and self.tcspc.address is not None

    @property
    def rehearsed(self) -> bool:
        """Whether the counts say nothing of a real rig: they are simulated, or played from a file."""
        return self.simulated or self.served or self.tcspc.kind == "playback"

    def for_record(self) -> str:
        """Return what a file of measurements says of it, JSON that `rig.model.config.recorded` reads.

        Notes have their own place there. Where something lies on this computer, and where cameras are
        reached, concerns nobody who is given the file, and is not used of it: absolute paths become names.
        A mesh's path stays as it was written, since resuming and truths read the mesh.
        """
        return _without_folders(self).model_dump_json(exclude={"notes": True, "cameras": {"addresses"}})

    def differences(self, other: "RigConfig") -> list[str]:
        """Return in which settings a scan with ``other`` differs, as ``key is A, was B``.

        Left out is what does not change what is measured: where devices are connected, limits, times to wait,
        cameras, the folder of calibrations, the plan of a scan, and notes.
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
    "delayer.address",
    "tcspc.library",
    "tcspc.serial",
    "tcspc.address",
    "tcspc.readout_time_s",
    "tcspc.file",
    "point_clock",
    "shutter",
    "scan.",
    "calibration.",
    "cameras.",
    "notes.",
    "simulation.real_time",
)


def _with_a_gate_that_exists(table: dict[str, Any]) -> dict[str, Any]:
    """Return a record whose detector is of a kind that there is, if it is of an earlier program.

    There, every detector was an ID120 with commands for a gate that no ID120 has. On a simulated bench it
    was what an MPD detector with a delayer is now, photon for photon.
    """
    detector = table.get("detector")
    if not isinstance(detector, dict) or "excess_bias_v" not in detector:
        return table
    detector = {key: value for key, value in detector.items() if key != "excess_bias_v"}
    tcspc = table.get("tcspc")
    served = isinstance(tcspc, dict) and tcspc.get("address") is not None
    if table.get("simulation") is None and not served:
        return {**table, "detector": {**detector, "kind": "id120"}}
    detector = {key: value for key, value in detector.items() if key != "serial"}
    delayer = {"kind": "psd", "address": detector.get("address")}
    return {**table, "detector": {**detector, "kind": "mpd"}, "delayer": delayer}


def _with_built_in_delayer(table: dict[str, Any]) -> dict[str, Any]:
    """Return a simulated rig that does not say what detector it has with all of the built-in rig's."""
    detector = table.get("detector", {})
    says = isinstance(detector, dict) and "kind" in detector
    return table if says or "delayer" in table or "simulation" not in table else {**table, "delayer": {}}


def _refuse_gated_id120(detector: Any) -> None:
    """Raise `ValueError` where a file gives an ID120 a gate, as files for earlier programs do."""
    if not isinstance(detector, dict):
        return
    is_older = "excess_bias" in detector or ("serial" in detector and "kind" not in detector)
    of_gate = {"gate_delay", "gate_width"} & detector.keys() if "gated" not in detector else set()
    wants_gate = detector.get("gated") is True or bool(of_gate)
    if is_older or (detector.get("kind") == "id120" and wants_gate):
        raise ValueError(
            "detector: an ID120 has no gate, nor an excess bias, that a public command sets. For a gated "
            "detector write detector.kind = 'mpd' (and a [delayer]), or 'external'; for an ID120, which "
            "is free-running, detector.kind = 'id120' without gated, gate_delay and gate_width. Leave "
            "excess_bias out (docs/detectors.md)"
        )


def _flat(table: dict[str, Any], within: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their dotted keys."""
    values: dict[str, Any] = {}
    for name, value in table.items():
        values |= _flat(value, f"{within}{name}.") if isinstance(value, dict) else {within + name: value}
    return values


def _without_folders(section: Section) -> Section:
    """Return a section whose absolute paths are names, in the sections within it, too."""
    changes: dict[str, Any] = {}
    for name, value in section:
        if isinstance(value, Section):
            changes[name] = _without_folders(value)
        elif isinstance(value, Path) and value.is_absolute():
            changes[name] = Path(value.name)
    return section.model_copy(update=changes)
