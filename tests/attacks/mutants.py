"""Files that were good and are no longer: mutated by bytes, or by structure; each follows from its seed."""

from pathlib import Path

import h5py
import numpy as np

#: Bytes and words at which counters, sizes and addresses turn over.
_EDGES = (0x00, 0x01, 0x7F, 0x80, 0xFF)
_NUMBERS = (0, -1, 1, 2**31 - 1, 2**63 - 1, np.nan, np.inf, -np.inf, 1e308, 1e-308)
_TEXTS = ("", "{}", "[]", "null", "5", '{"passes": 3}', "[" * 5000, "\ud800", "9" * 5000, "1e999")


def by_bytes(good: bytes, seed: int) -> bytes:
    """Change a few places of a file; every fourth is cut, too."""
    rng = np.random.default_rng([seed, 1])
    content = bytearray(good)
    for _ in range(int(rng.choice([1, 1, 2, 4, 16]))):
        # metadata lies at the front and between the data: half of the changes go to the first 8 kB
        start = int(rng.integers(min(len(content), 8192) if rng.random() < 0.5 else len(content)))
        size = int(rng.choice([1, 1, 2, 4, 8, 64]))
        kind = int(rng.integers(3))
        if kind == 0:
            content[start : start + size] = rng.bytes(size)
        elif kind == 1:
            content[start : start + size] = bytes([int(rng.choice(_EDGES))]) * size
        else:
            content[start] ^= 1 << int(rng.integers(8))
    if rng.random() < 0.05:
        del content[int(rng.integers(len(content))) :]
    return bytes(content)


def by_structure(path: Path, seed: int) -> None:
    """Edit an HDF5 file in place: what is missing, of another type or shape, huge, or elsewhere."""
    rng = np.random.default_rng([seed, 2])
    with h5py.File(path, "r+") as file:
        places: list[str] = []
        file.visit(places.append)
        many = int(rng.integers(1, 4))
        edits = [(_EDITS[int(rng.integers(len(_EDITS)))], str(rng.choice(places))) for _ in range(many)]
        # chunks of a wrong size last: HDF5 reads a chunk of which it writes a part, and would crash here
        for edit, name in sorted(edits, key=lambda one: one[0] is _short_chunk):
            if name in file:
                edit(file, name, rng)


def _number(rng):
    return _NUMBERS[int(rng.integers(len(_NUMBERS)))]


def _remove(file, name, rng):
    del file[name]


def _attribute(file, name, rng):
    owner = file[name] if rng.random() < 0.7 else file
    names = list(owner.attrs)
    if names:
        text = _TEXTS[int(rng.integers(len(_TEXTS)))].encode("utf-8", "surrogatepass")
        value = np.bytes_(text) if rng.random() < 0.5 else _number(rng)
        owner.attrs[str(rng.choice(names))] = value


def _values(file, name, rng):
    found = file[name]
    if isinstance(found, h5py.Dataset) and found.dtype.kind in "uif" and found.size:
        with np.errstate(all="ignore"):
            value = np.full(found.shape, _number(rng)).astype(found.dtype)
        found[...] = value


def _replaced(file, name, rng):
    found = file[name]
    if not isinstance(found, h5py.Dataset):
        return
    shape = list(found.shape)
    if shape:
        axis = int(rng.integers(len(shape)))
        shape[axis] = int(rng.choice([0, 1, shape[axis] + 1, 2**20, 2**31, 2**40]))
    kept = dict(found.attrs)
    del file[name]
    dtype = str(rng.choice(["u1", "i8", ">f8", "f2", "c16", "S9"]))
    file.create_dataset(name, shape, dtype, chunks=tuple(min(n, 64) or 1 for n in shape) or None)
    file[name].attrs.update(kept)


def _group(file, name, rng):
    del file[name]
    file.create_group(name)


def _linked(file, name, rng):
    del file[name]
    elsewhere = h5py.ExternalLink("/etc/hostname", "/") if rng.random() < 0.5 else h5py.SoftLink("/" + name)
    file[name] = elsewhere


def _outside(file, name, rng):
    del file[name]
    file.create_dataset(name, (4, 3), "u1", external=[("/etc/hostname", 0, 12)])


def _short_chunk(file, name, rng):
    found = file[name]
    if isinstance(found, h5py.Dataset) and found.chunks and found.dtype.kind in "uif":
        size = int(rng.choice([0, 1, 3, 100, 5000]))
        found.id.write_direct_chunk((0,) * found.ndim, rng.bytes(size), int(rng.choice([0, 1, 3])))


_EDITS = (_remove, _attribute, _attribute, _values, _replaced, _group, _linked, _outside, _short_chunk)
