"""A scan file of histograms, written again in the time-tagged form."""

import numpy as np

from rig.files import ScanDescription, ScanFile, ScanWriter


def description_of(scan, *, tagged):
    """Return what a scan file says before its first photon."""
    return ScanDescription(
        laser_m=scan.laser_m,
        detector_m=scan.detector_m,
        bins=scan.bins,
        bin_width_s=scan.bin_width_s,
        first_bin_s=scan.first_bin_s,
        delays=scan.delays,
        delay_s=scan.delay_s,
        channels=scan.channels,
        plan=scan.plan,
        state=scan.state,
        simulated=scan.simulated,
        command=scan.command,
        devices=scan.devices,
        fade_from_s=scan.fade_from_s,
        gate_start_s=scan.gate_start_s,
        gate_stop_s=scan.gate_stop_s,
        instrument_response_s=scan.instrument_response_s,
        mirror_rad=scan.mirror_rad,
        tagged=tagged,
    )


def photons_of(counts, rng):
    """Return the photons of (channels, bins) counts one by one, and how many each channel has."""
    bins = np.arange(counts.shape[-1], dtype=np.uint16)
    photons = [rng.permutation(np.repeat(bins, row)) for row in counts]
    return np.concatenate(photons), np.array([len(one) for one in photons])


def write_tagged(source, target, measured=None, line=8):
    """Write the photons of a scan file into one of the time-tagged form."""
    rng = np.random.default_rng(0)
    with ScanFile(source) as scan, ScanWriter.create(target, description_of(scan, tagged=True)) as writer:
        for step in range(scan.steps if measured is None else measured):
            photons, of_channel = photons_of(scan.counts(range(step, step + 1))[0], rng)
            writer.append_photons(photons, of_channel, float(scan.live_time_s[step]))
            if step % line == line - 1:
                writer.checkpoint()
    return target
