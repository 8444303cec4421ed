"""A scan file of histograms, written again in the time-tagged form."""

from dataclasses import replace

import numpy as np

from rig.files import ScanFile, ScanWriter
from rig.live.follow import described


def photons_of(counts, rng):
    """Return the photons of (channels, bins) counts one by one, and how many each channel has."""
    bins = np.arange(counts.shape[-1], dtype=np.uint16)
    photons = [rng.permutation(np.repeat(bins, row)) for row in counts]
    return np.concatenate(photons), np.array([len(one) for one in photons])


def _tagged(scan):
    """Return what the other file says before its first photon."""
    return replace(described(scan), devices=scan.devices, mirror_rad=scan.mirror_rad, tagged=True)


def write_tagged(source, target, measured=None, line=8):
    """Write the photons of a scan file into one of the time-tagged form."""
    rng = np.random.default_rng(0)
    with ScanFile(source) as scan, ScanWriter.create(target, _tagged(scan)) as writer:
        for step in range(scan.steps if measured is None else measured):
            photons, of_channel = photons_of(scan.counts(range(step, step + 1))[0], rng)
            writer.append_photons(photons, of_channel, float(scan.live_time_s[step]))
            if step % line == line - 1:
                writer.checkpoint()
    return target
