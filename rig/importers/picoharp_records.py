"""Time-tagged records of a PicoHarp 300, decoded in bulk.

A record is 32 bits, little endian (source: the vendor's demo readers of unified files, ``readPT2`` and
``readPT3``). UNCONFIRMED by a file of a real instrument, but for what is known of its first photons.

    bits    31..28     27..16    15..0
    T3      channel    dtime     nsync     nsync counts sync pulses, modulo 65,536
    T2      channel    time (27..0)        in 4 ps, modulo 210,698,240

    channel    what it is
    0          T2: a pulse at input 0, where the laser's sync pulses come; T3: not used
    1 to 4     a photon, by the router's input; 1 without a router
    15         special: in T3 a marker where dtime is not 0, in T2 where the lowest four bits are not 0; these
               bits are the marked inputs. Else the counter has wrapped once

The lowest four bits of a T2 marker's time are its inputs, so that its time is known to 64 ps only.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.harp.records import MAX_TAG, SYNC_CHANNEL, Batch, DamagedRecordsError

_T3_PERIOD, _T2_PERIOD = 65_536, 210_698_240
_SPECIAL, _LAST_INPUT = 15, 4


class PicoHarpDecoder:
    """Decodes a stream of records that comes in pieces, as `drivers.harp.records.Decoder` does.

    Parameters
    ----------
    is_t3
        Whether the records are those of T3.
    """

    def __init__(self, is_t3: bool) -> None:
        self._is_t3 = is_t3
        self._base = 0

    def decode(self, buffer: NDArray[np.uint32]) -> Batch:
        """Decode the next piece, (records,) uint32, into memory of its own.

        Raises
        ------
        DamagedRecordsError
            When tags exceed `MAX_TAG`.
        """
        n = len(buffer)
        tag, dtime, channel = np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.int8)
        marker_tag, mask, before = np.empty(n, np.int64), np.empty(n, np.uint8), np.empty(n, np.int64)
        decode = _decode_t3 if self._is_t3 else _decode_t2
        self._base, p, m, wraps, unknown = decode(
            buffer, self._base, (tag, dtime, channel), (marker_tag, mask, before)
        )
        if self._base > MAX_TAG:
            raise DamagedRecordsError("the overflow records count on beyond the longest measurement")
        return Batch(tag[:p], dtime[:p], channel[:p], marker_tag[:m], mask[:m], before[:m], wraps, unknown)


@njit(cache=True, nogil=True)
def _decode_t3(records, base, photon_arrays, marker_arrays):  # type: ignore[no-untyped-def]
    """Decode into the arrays; return the new base, and numbers of photons, markers, wraps, unknown."""
    tag, dtime, channel = photon_arrays
    marker_tag, marker_mask, marker_photon = marker_arrays
    photons = markers = wraps = unknown = 0
    for i in range(len(records)):
        record = np.int64(records[i])
        code, delay, count = record >> 28, (record >> 16) & 0xFFF, record & 0xFFFF
        if 1 <= code <= _LAST_INPUT:
            tag[photons], dtime[photons], channel[photons] = base + count, delay, code
            photons += 1
        elif code == _SPECIAL and delay == 0:
            wraps += 1
            base += _T3_PERIOD
        elif code == _SPECIAL and delay <= 15:
            marker_tag[markers], marker_mask[markers], marker_photon[markers] = base + count, delay, photons
            markers += 1
        else:
            unknown += 1
    return base, photons, markers, wraps, unknown


@njit(cache=True, nogil=True)
def _decode_t2(records, base, photon_arrays, marker_arrays):  # type: ignore[no-untyped-def]
    """Decode as `_decode_t3`."""
    tag, dtime, channel = photon_arrays
    marker_tag, marker_mask, marker_photon = marker_arrays
    photons = markers = wraps = unknown = 0
    for i in range(len(records)):
        record = np.int64(records[i])
        code, count, mask = record >> 28, record & 0xFFFFFFF, record & 15
        if code <= _LAST_INPUT:
            tag[photons], dtime[photons] = base + count, 0
            channel[photons] = code if code else SYNC_CHANNEL
            photons += 1
        elif code == _SPECIAL and mask == 0:
            wraps += 1
            base += _T2_PERIOD
        elif code == _SPECIAL:
            marker_tag[markers], marker_mask[markers], marker_photon[markers] = (
                base + count - mask,
                mask,
                photons,
            )
            markers += 1
        else:
            unknown += 1
    return base, photons, markers, wraps, unknown
