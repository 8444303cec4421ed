"""The simulated bench that a configuration describes, and the truth of its scenes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.gates import detector_head, gate_delayer
from rig.errors import ConfigError, DataFileError, UsageError
from rig.files.recorded import digest_of_file
from rig.model.config import (
    AnalogueGalvoConfig,
    DaqClockConfig,
    DaqShutterConfig,
    DeviceSection,
    ExternalLaserConfig,
    FaultsConfig,
    HarpConfig,
    Katana08Config,
    KatanaConfig,
    NktConfig,
    RigConfig,
    SerialShutterConfig,
    SimulationConfig,
    TcspcConfig,
    TimeHarp260Config,
)
from rig.model.config.kinds import ROLES
from rig.model.quantities import parse

if TYPE_CHECKING:
    from simulators.bench import Bench, BenchGeometry, Channel, LightState, Photons
    from simulators.detector import Detector
    from simulators.detector.first_bounce import FirstBounce
    from simulators.scenes import Scene
    from simulators.transport.renderer import Transport
    from simulators.wire.daq import DaqWiring
    from simulators.wire.harp import HarpSimulator, SimulatedFamily, Timing
    from simulators.wire.instruments import SimulatedInstruments
    from simulators.wire.laser_head import LaserHead
    from simulators.wire.shutter import PortShutter

#: By how much the mirror of each kind trails its command [s] (unconfirmed). A galvanometer of 2.5 kHz is
#: within a thousandth of a small step in 0.6 ms; the GVS011's specification is 0.4 ms, to an unsaid fraction.
MIRROR_LAG_S = {"optotune": 0.8e-3, "analogue": 1 / (np.pi * 2500)}

#: The mean rate is taken over so many laser spots along x and y.
RATE_SPOTS = (9, 6)


def simulated_instruments(config: RigConfig, begin_s: float = 0.0) -> "tuple[Bench, SimulatedInstruments]":
    """Build the bench and its instruments, which are yet to be entered.

    Its clock begins at ``begin_s``.

    Raises
    ------
    ConfigError
        If there is no such scene, or it cannot be made as bright as wanted.
    """
    from simulators.wire.instruments import SimulatedInstruments

    simulation = config.simulation or SimulationConfig()
    bench = simulated_bench(config, real_time=simulation.real_time, begin_s=begin_s)
    return bench, SimulatedInstruments(
        bench,
        laser=laser_head(config),
        detector=detector_head(config),
        delayer=gate_delayer(config),
        shutter=port_shutter(config),
        timing=timing_instrument(config),
        wiring=daq_wiring(config),
    )


def timing_instrument(config: RigConfig) -> "Callable[[Bench], HarpSimulator]":
    """Return what makes the simulated timing instrument, on a bench."""
    from simulators.wire.harp import HarpSimulator

    faults = (config.simulation or SimulationConfig()).faults
    return partial(
        HarpSimulator,
        family=simulated_family(config.tcspc),
        timing=timing_faults(config),
        count_depth=faults.largest_count,
    )


def simulated_family(tcspc: TcspcConfig) -> "SimulatedFamily":
    """Return what timing instrument is simulated; one that plays a file leaves a HydraHarp 400 unused."""
    from simulators.wire.harp import FAMILIES

    board = tcspc.board.lower() if isinstance(tcspc, TimeHarp260Config) else ""
    return FAMILIES[f"{tcspc.kind}{board}" if isinstance(tcspc, HarpConfig) else "hydraharp"]


def laser_head(config: RigConfig) -> "Callable[[Bench], LaserHead] | None":
    """Return what makes the simulated laser of the configured kind, on a bench; None without interface.

    Raises
    ------
    ConfigError
        If the package that brings the kind has no simulator.
    """
    from simulators.wire.laser import Katana08Head, KatanaHead
    from simulators.wire.nkt import NktMainboard

    laser = config.laser
    if isinstance(laser, ExternalLaserConfig):
        return None
    if isinstance(laser, NktConfig):
        return partial(NktMainboard, oscillator_hz=laser.oscillator_hz)
    own = {KatanaConfig: KatanaHead, Katana08Config: Katana08Head}
    return own.get(type(laser)) or _simulated_elsewhere("laser", laser)


def _simulated_elsewhere(role: str, section: DeviceSection) -> "Callable[[Bench], Any]":
    """Return the simulator that an installed package brings."""
    found = ROLES[role].installed(section.kind)
    if found is None or found.simulated is None:
        raise ConfigError(
            f"{role}.kind = '{section.kind}' has no simulator: leave [simulation] out, or choose another kind"
        )
    return found.simulated


def port_shutter(config: RigConfig) -> "Callable[[Bench], PortShutter] | None":
    """Return what makes the simulated shutter on a serial port, on a bench; None where there is none."""
    from simulators.wire.shutter import PortShutter

    shutter = config.shutter
    if not isinstance(shutter, SerialShutterConfig):
        return None
    return partial(PortShutter, line=shutter.line, opens_high=shutter.open_level == "high")


def daq_wiring(config: RigConfig) -> "DaqWiring":
    """Return what hangs on the DAQ board."""
    from simulators.wire.daq import DaqWiring

    wiring = DaqWiring((), None)
    if isinstance(clock := config.point_clock, DaqClockConfig):
        wiring = replace(wiring, markers=clock.markers, step=clock.step or None)
    if isinstance(galvo := config.galvo, AnalogueGalvoConfig):
        wiring = replace(wiring, channels=galvo.channels, volts_per_degree=galvo.volts_per_degree)
    if isinstance(shutter := config.shutter, DaqShutterConfig):
        wiring = replace(wiring, shutter=shutter.line, opens_high=shutter.open_level == "high")
    return wiring


def simulated_bench(config: RigConfig, *, real_time: bool, begin_s: float = 0.0) -> "Bench":
    """Build the bench; its clock begins at ``begin_s``.

    Raises
    ------
    ConfigError
        If there is no such scene, or it cannot be made as bright as wanted.
    """
    from simulators.bench import Bench
    from simulators.clock import BenchClock
    from simulators.motion.mirror import SteeringMirror

    simulation = config.simulation or SimulationConfig()
    geometry = true_geometry(config)
    clock = BenchClock(real_time=real_time, begin_s=begin_s)
    asked_s = simulation.misalignment.mirror_lag_s
    mirror = SteeringMirror.trailing(MIRROR_LAG_S[config.galvo.kind] if asked_s is None else asked_s)
    bench = Bench(_photons(config, geometry), geometry, seed=simulation.seed, clock=clock, mirror=mirror)
    if isinstance(config.laser, ExternalLaserConfig):  # nobody but a person can set this one
        bench.change_light(power=1.0, repetition_hz=config.laser.repetition_hz)
    if config.shutter is not None:
        bench.change_light(shuttered=True)
    return bench


def timing_faults(config: RigConfig) -> "Timing":
    """Return what the clock of the timing instrument does wrong."""
    from simulators.wire.harp import Nonlinearity, Pulses, Timing

    simulation = config.simulation or SimulationConfig()
    faults = simulation.faults
    return Timing(
        dead_time_s=faults.dead_time_s,
        nonlinearity=Nonlinearity(rms=faults.nonlinearity, seed=simulation.seed),
        drift_s_per_s=faults.drift_per_minute_s / 60,
        pulses=Pulses(faults.sync_pulse_v, faults.input_pulse_v, faults.line_noise_v),
    )


def true_geometry(config: RigConfig) -> "BenchGeometry":
    """Return where things really stand in the wall's frame: as configured, and then misaligned.

    A tilted wall is a rig that is turned the other way about the wall's centre. The detector still looks at
    its mark on the wall, since it was pointed there by eye.
    """
    from simulators.bench import BenchGeometry
    from simulators.motion.mount import MirrorMount, rotated

    wrong = (config.simulation or SimulationConfig()).misalignment
    about_vertical, about_horizontal = wrong.wall_tilt_rad
    turn = rotated(-about_horizontal, -about_vertical, 0.0)
    galvo_m = turn @ np.add(config.galvo.position_m, wrong.galvo_shift_m)
    head_m = turn @ np.add(config.detector.position_m, wrong.spad_shift_m)
    rotation = turn @ rotated(*wrong.mirror_turn_rad)
    return BenchGeometry(
        galvo_m=tuple(galvo_m.tolist()),
        detector_head_m=tuple(head_m.tolist()),
        channels=_channels(config),
        electronics_delay_s=config.timing.electronics_delay_s + wrong.cable_delay_s,
        mount=MirrorMount(
            rotation=tuple(map(tuple, rotation.tolist())),
            offset_rad=wrong.mirror_offset_rad,
            gain=wrong.mirror_gain,
            incidence_rad=config.galvo.incidence_rad + wrong.mirror_incidence_rad[0],
            incidence_direction_rad=config.galvo.incidence_direction_rad + wrong.mirror_incidence_rad[1],
            mirrors=config.galvo.mirrors,
            separation_m=config.galvo.separation_m,
        ),
    )


def _channels(config: RigConfig) -> "tuple[Channel, ...]":
    from simulators.bench import Channel

    return tuple(
        Channel(spot_m=channel.spot_m, input=channel.input, delay_s=channel.delay_s)
        for channel in config.channels
    )


def hidden_scene(config: RigConfig) -> "Scene":
    """Build the hidden scene, with the gloss that is wanted.

    Raises
    ------
    ConfigError
        If there is no such scene.
    """
    from simulators.scenes import Placement, scene

    simulation = config.simulation or SimulationConfig()
    if (mesh := simulation.mesh) and not mesh_is_as_it_was(simulation):
        raise ConfigError(
            f"simulation.scene: {mesh} is not the file that the scan began with (its SHA-256 is not "
            f"{simulation.mesh_sha256[:12]}...); put that file back, or start a new scan"
        )
    placement = Placement(simulation.place_m, simulation.rotate_rad, simulation.scale)
    try:
        hidden = scene(simulation.scene, placement)
    except (ValueError, ModuleNotFoundError) as error:
        raise ConfigError(f"simulation.scene: {error}") from None
    if simulation.roughness is not None:
        hidden = hidden.with_roughness(simulation.roughness)
    return hidden if simulation.gloss is None else hidden.with_gloss(simulation.gloss)


def mesh_is_as_it_was(simulation: SimulationConfig) -> bool:
    """Return whether a mesh is the one that is meant, or nobody said which; a missing one is told later."""
    mesh = simulation.mesh
    if mesh is None or not simulation.mesh_sha256 or not mesh.is_file():
        return True
    return digest_of_file(mesh) == simulation.mesh_sha256


def scene_depth(name: str, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the true depth (y, x) of a built-in scene of the simulator, NaN where nothing is.

    The name may say by how much the scene is moved: ``four@10cm,0cm,0cm``.

    Raises
    ------
    UsageError
        If there is no such scene.
    """
    from simulators.scenes import scene

    found, _, moved = name.partition("@")
    try:
        return scene(found).moved(_offset_m(moved)).depth_map(x_m, y_m)
    except ValueError as error:
        raise UsageError(f"scene:{name}: {error}") from None


def _offset_m(text: str) -> tuple[float, float, float]:
    """Read by how much a scene is moved, e.g. ``10cm,0cm,0cm``; nothing is not at all."""
    parts = text.split(",") if text else ["0m"] * 3
    if len(parts) != 3:
        raise ValueError(f"'{text}' is not a movement: write x, y and z, e.g. @10cm,0cm,0cm")
    x_m, y_m, z_m = (parse(part, "length") for part in parts)
    return x_m, y_m, z_m


def mesh_triangles_m(path: Path) -> NDArray[np.float64]:
    """Return the (T, 3, 3) triangles of a mesh file.

    Raises
    ------
    UsageError
        If the library that reads meshes is not installed.
    DataFileError
        If the file is damaged, or holds nothing in front of the wall.
    """
    from simulators.scenes.files import from_file

    try:
        return from_file(path).triangles_m
    except ModuleNotFoundError as error:
        raise UsageError(str(error)) from None
    except ValueError as error:
        raise DataFileError(str(error)) from None


def renderer(config: RigConfig) -> "Transport":
    """Return what follows the light in the hidden scene.

    Raises
    ------
    ConfigError
        If there is no such scene.
    """
    from simulators.optics.light import Optics
    from simulators.transport.renderer import Transport

    bounces = (config.simulation or SimulationConfig()).bounces
    return Transport.of_scene(hidden_scene(config), bounces=bounces, wall_albedo=Optics().wall_albedo)


def _photons(config: RigConfig, geometry: "BenchGeometry") -> "Sequence[Photons]":
    """Return the physics of each detector channel."""
    from simulators.optics.brightness import tuned
    from simulators.optics.light import Optics

    simulation = config.simulation or SimulationConfig()
    seen, first_bounce = _scene_photons(config), _first_bounce(simulation.faults, simulation.seed)
    photons = [
        seen(
            geometry,
            Optics(),
            _detector(simulation.faults),
            first_bounce,
            detector_spot_m=channel.spot_m,
        )
        for channel in geometry.channels
    ]
    if simulation.count_rate_hz is None:
        return photons
    # at a failed gate the first bounce is counted, by the million, and hides the light that is tuned
    good_m = [
        spot
        for spot in _spots(config)
        if not any(first_bounce.fails(spot, channel.spot_m) for channel in geometry.channels)
    ]
    try:
        return tuned(photons, good_m or _spots(config), _light(config), simulation.count_rate_hz)
    except ValueError as error:
        raise ConfigError(f"simulation.count_rate: {error}; choose another rate or scene") from None


def _scene_photons(config: RigConfig) -> "Callable[..., Photons]":
    """Return what makes the physics of a channel, for a scene that stands or one that moves."""
    from simulators.motion.path import BackAndForth
    from simulators.moving import MovingScenePhotons
    from simulators.photons import HiddenScenePhotons

    motion = (config.simulation or SimulationConfig()).motion
    if motion is None:
        return partial(HiddenScenePhotons, renderer(config))
    return partial(MovingScenePhotons, renderer(config), BackAndForth(motion.travel_m, motion.duration_s))


def _detector(faults: FaultsConfig) -> "Detector":
    from simulators.detector import Afterpulsing, Detector, Ringing

    return Detector(
        dark_hz=faults.dark_counts_hz,
        ambient_hz=faults.ambient_light_hz,
        ringing=Ringing(faults.gate_ringing, faults.gate_ringing_decay_s),
        holds_off=faults.hold_off,
        afterpulsing=Afterpulsing(faults.afterpulse_probability, faults.afterpulse_decay_s),
    )


def _first_bounce(faults: FaultsConfig, seed: int) -> "FirstBounce":
    from simulators.detector.first_bounce import FirstBounce

    return FirstBounce(
        memory=faults.memory,
        memory_decay_s=faults.memory_decay_s,
        reflection_per_pulse=faults.reflections_per_pulse,
        failed_fraction=faults.failed_gates,
        failed_radius_m=faults.failed_gate_radius_m,
        seed=seed,
    )


def _spots(config: RigConfig) -> list[tuple[float, float, float]]:
    """Return spots in the middles of equal parts of the scanned wall, those at a channel's left out."""
    scan, (columns, rows) = config.scan, RATE_SPOTS
    x_m = ((np.arange(columns) + 0.5) / columns - 0.5) * scan.columns * scan.spacing_m
    y_m = ((np.arange(rows) + 0.5) / rows - 0.5) * scan.rows * (scan.row_spacing_m or scan.spacing_m)
    looked_at_m = [channel.spot_m[:2] for channel in _channels(config)]
    away_m = scan.skip_m / 2
    return [
        (float(x), float(y), 0.0)
        for x in x_m
        for y in y_m
        if all(np.hypot(x - x_c, y - y_c) > away_m for x_c, y_c in looked_at_m)
    ]


def _light(config: RigConfig) -> "LightState":
    from simulators.bench import LightState

    spad, laser = config.detector, config.laser
    return LightState(
        emitting=True,
        power=laser.fraction_of_full,
        repetition_hz=laser.repetition_hz,
        biased=True,
        gated=spad.gated,
        gate_delay_s=spad.gate_delay_s,
        gate_width_s=spad.gate_width_s,
        hold_off_s=spad.hold_off_s,
    )
