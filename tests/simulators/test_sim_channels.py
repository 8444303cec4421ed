"""A detector of many pixels: each looks at its own spot, has its own photons and its own input."""

from math import dist

import numpy as np
import pytest
from scipy.stats import chi2

from drivers.harp.families import HYDRAHARP_400
from drivers.harp.library import HarpLibrary, histogram_buffers
from simulators.bench import Bench, BenchGeometry, Channel, LightState, no_detections
from simulators.constants import C_M_PER_S
from simulators.detector import Detector
from simulators.optics.light import Optics
from simulators.photons import HiddenScenePhotons
from simulators.scenes import scene
from simulators.transport.renderer import Transport
from simulators.wire.harp import HarpSimulator
from support.exact_light import EXACT

OPTICS = Optics(stray_per_pulse=0, pulse_fwhm_s=0, power_w=5.0)
PIXELS = 16
#: Pixel k looks at a spot of a row 60 cm wide, and its cable is 0.1 ns longer than that of the pixel before.
ROW = tuple(
    Channel(spot_m=(0.04 * k - 0.3, 0.1, 0.0), input=PIXELS - 1 - k, delay_s=0.1e-9 * k)
    for k in range(PIXELS)
)
LASER = (0.3, 0.2, 0.0)


@pytest.fixture(scope="module")
def letters():
    return Transport.of_scene(scene("letters"))


def pixels(letters, geometry, detector=EXACT):
    return [
        HiddenScenePhotons(letters, geometry, OPTICS, detector, detector_spot_m=channel.spot_m)
        for channel in geometry.channels
    ]


def lit(photons, geometry, seed=0):
    bench = Bench(photons, geometry, seed=seed)
    bench.change_light(emitting=True, biased=True)
    return bench


def histograms(bench, exposure_ms, bins):
    """Counts (inputs, bins of 16 ps) of one measurement, by the C functions alone."""
    simulator = HarpSimulator(bench)
    library = HarpLibrary(simulator.functions, HYDRAHARP_400)
    library.open_device(0)
    library.initialize(0, 0, 0)
    library.calibrate(0)
    library.set_binning(0, 4)
    library.start_meas(0, exposure_ms)
    bench.clock.sleep(exposure_ms / 1000)
    library.stop_meas(0)
    counts = np.zeros((library.get_num_of_input_channels(0), bins), np.uint32)
    (buffer,) = histogram_buffers(1, 65536)
    for at_input, row in enumerate(counts):
        library.get_histogram(0, at_input, buffer)
        row[:] = np.frombuffer(buffer, np.uint32, bins)
    simulator.raise_pending()
    return counts


def test_each_input_counts_the_transient_of_its_channels_spot(letters):
    """Chi-square against the renderer for each spot: right programs fail once in a million; fixed seed."""
    geometry = BenchGeometry(channels=ROW)
    bench = lit(pixels(letters, geometry), geometry)
    laser_m = geometry.laser_spot_m(bench.mirror.position(0.0))
    counts = histograms(bench, 100, 3000)
    assert counts.shape == (PIXELS, 3000)
    edges_s = 16e-12 * np.arange(3001)
    for channel in ROW:
        drawn = counts[channel.input]
        outside_m = dist(geometry.galvo_m, laser_m) + dist(channel.spot_m, geometry.detector_head_m)
        shift_s = geometry.electronics_delay_s + channel.delay_s + outside_m / C_M_PER_S
        spots = np.array([laser_m]), np.array([channel.spot_m])
        expected = letters.transients(*spots, edges_s - shift_s)[0]
        expected *= drawn.sum() / expected.sum()
        enough = expected > 20
        assert drawn.sum() > 1e5
        statistic = ((drawn - expected)[enough] ** 2 / expected[enough]).sum()
        assert statistic < chi2.isf(1e-6, enough.sum())


def test_the_inputs_rates_are_those_of_the_channels(letters):
    geometry = BenchGeometry(channels=ROW)
    bench = lit(pixels(letters, geometry), geometry)
    simulator = HarpSimulator(bench)
    library = HarpLibrary(simulator.functions, HYDRAHARP_400)
    library.open_device(0)
    library.initialize(0, 0, 0)
    bench.clock.sleep(0.2)
    rates = [library.get_count_rate(0, channel.input) for channel in ROW]
    assert rates == [round(bench.count_rate_hz(number)) for number in range(PIXELS)]
    assert len(set(rates)) == PIXELS


class Uniform:
    """Detections straight from the random numbers."""

    def detections(self, laser_spot_m, light, duration_s, rng):
        seen = no_detections()
        return type(seen)(np.arange(1000), rng.random(1000))

    def rate_hz(self, laser_spot_m, light):
        return 0.0


def test_channels_share_no_random_numbers():
    geometry = BenchGeometry(channels=tuple(Channel(input=k) for k in range(PIXELS)))
    seen = Bench([Uniform()] * PIXELS, geometry, seed=3).detections(0.0, 1e-3)
    times = np.concatenate([one.time_s for one in seen])
    assert len(np.unique(times)) == PIXELS * 1000
    again = Bench([Uniform()] * PIXELS, geometry, seed=3).detections(0.0, 1e-3)
    assert all(np.array_equal(one.time_s, other.time_s) for one, other in zip(seen, again, strict=True))


def test_the_first_channel_does_not_know_of_the_others(letters):
    """A detector of one pixel and the first of sixteen see the same photons, to the last bit."""
    detector = Detector()
    alone, row = (BenchGeometry(channels=ROW[:n]) for n in (1, PIXELS))
    (one,) = lit(pixels(letters, alone, detector), alone, 5).detections(0.0, 0.01)
    first, *others = lit(pixels(letters, row, detector), row, 5).detections(0.0, 0.01)
    assert len(one) > 1000
    assert np.array_equal(one.pulse, first.pulse)
    assert np.array_equal(one.time_s, first.time_s)
    assert len(others) == PIXELS - 1


def test_pixels_may_differ_in_their_dark_counts(letters):
    geometry = BenchGeometry(channels=(Channel(input=0), Channel(input=1)))
    photons = [
        HiddenScenePhotons(letters, geometry, detector=Detector(dark_hz=hz, ambient_hz=0)) for hz in (1e4, 0)
    ]
    noisy, quiet = Bench(photons, geometry).detections(0.0, 0.0)
    assert len(noisy) == len(quiet) == 0
    bench = Bench(photons, geometry)
    bench.change_light(biased=True)
    bench.clock.sleep(1.0)
    noisy, quiet = bench.detections(0.0, 1.0)
    assert len(noisy) == pytest.approx(1e4, abs=5 * 100)
    assert len(quiet) == 0


def test_a_full_bin_of_one_input_stops_all_of_them():
    """Stop counts of 50: the fast input's one bin is full after half of the time."""

    class Steady:
        def __init__(self, number):
            self.number = number

        def detections(self, laser_spot_m, light, duration_s, rng):
            return type(no_detections())(np.arange(self.number), np.full(self.number, 5e-9))

    geometry = BenchGeometry(channels=(Channel(input=0), Channel(input=1)))
    bench = lit([Steady(100), Steady(40)], geometry)
    simulator = HarpSimulator(bench)
    library = HarpLibrary(simulator.functions, HYDRAHARP_400)
    library.open_device(0)
    library.initialize(0, 0, 0)
    library.calibrate(0)
    library.set_stop_overflow(0, True, 50)
    library.start_meas(0, 10)
    bench.clock.sleep(0.01)
    library.stop_meas(0)
    assert library.get_elapsed_meas_time(0) == pytest.approx(5.0)
    (buffer,), counted = histogram_buffers(1, 65536), []
    for at_input in (0, 1):
        library.get_histogram(0, at_input, buffer)
        counted.append(int(np.frombuffer(buffer, np.uint32).sum()))
    assert counted == [50, 20]
    simulator.raise_pending()


def test_impossible_channels_are_refused():
    with pytest.raises(ValueError, match="an input of its own"):
        BenchGeometry(channels=(Channel(input=1), Channel(input=1)))
    with pytest.raises(ValueError, match="photons of 1 channels for a detector of 2"):
        Bench([Uniform()], BenchGeometry(channels=(Channel(), Channel(input=1))))


class OneMirror:
    """Another renderer: all light comes from one place, as in a mirror."""

    def light_paths(self, detector_spot_m):
        self.detector_spot_m = detector_spot_m
        return (self,)

    def flux(self, laser_spot_m):
        return 1e-4

    def sample(self, laser_spot_m, number, rng):
        return np.full(number, self._path_m(laser_spot_m))

    def arrivals(self, laser_spot_m):
        return np.array([1e-4]), np.array([self._path_m(laser_spot_m)])

    def _path_m(self, laser_spot_m):
        return dist(laser_spot_m, (0.0, 0.0, 1.0)) + dist((0.0, 0.0, 1.0), self.detector_spot_m)


def test_any_renderer_will_do():
    photons = HiddenScenePhotons(OneMirror(), optics=OPTICS, detector=EXACT, detector_spot_m=(0.1, 0.0, 0.0))
    light, g = LightState(emitting=True, biased=True), photons.geometry
    seen = photons.detections(LASER, light, 1.0, np.random.default_rng(0))
    path_m = dist(g.galvo_m, LASER) + dist(LASER, (0, 0, 1)) + dist((0, 0, 1), (0.1, 0, 0))
    path_m += dist((0.1, 0, 0), g.detector_head_m)
    assert seen.time_s == pytest.approx(g.electronics_delay_s + path_m / C_M_PER_S, abs=1e-18)
    rate_hz = photons.rate_hz(LASER, light)
    assert rate_hz > 1000
    assert len(seen) == pytest.approx(rate_hz, abs=5 * np.sqrt(rate_hz))
