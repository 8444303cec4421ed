"""Walking through an HDF5 file from outside: what leads out of it, and what claims more than it can hold.

Nothing here reads measurements. All objects, attributes, filters and the index of chunks are looked at, so
that a library that crashes or loops on them does so in the trial (`rig.files.trial`), not in the program.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice, product
from math import prod
from pathlib import Path
from typing import Any

import h5py

from rig.errors import DataFileError, in_a_line
from rig.files.opened import hdf5_file
from rig.files.trial import tried

#: Objects of a file, attributes of an object, groups in groups, axes of an array. A scan has about 50 objects
#: of at most 3 axes; MATLAB keeps each cell as an object; rendered transients have up to 7 axes.
OBJECTS, ATTRIBUTES, DEPTH, AXES = 100_000, 1000, 16, 8
#: Bytes of one attribute or text; a plan that lists 200,000 positions has 10 MB.
TEXT_BYTES = 64 * 2**20
#: Bytes of one chunk, unpacked: it is the least that can be read at once.
CHUNK_BYTES = 64 * 2**20
#: deflate packs 258 bytes into 2 bits at best; `zlib.net/zlib_tech.html` gives 1032:1. LZF packs less.
PACKED = 1032
#: Filters by HDF5's number. Others are libraries that would have to be found and loaded, and are not.
FILTERS = {1: "deflate", 2: "shuffle", 3: "fletcher32", 32000: "lzf"}
_PACKING = {1, 32000}
#: A name that readers look for.
SOUGHT = "format"
#: What h5py raises on what is damaged.
_UNREADABLE = (OSError, RuntimeError, KeyError, ValueError, TypeError, OverflowError)

#: Files that one process walks through: a file of this program takes it some milliseconds.
AT_ONCE = 50

_inspected: dict[tuple[str, int, int, int], str] = {}


def inspect(path: Path) -> None:
    """Walk through a file in a process of its own; a file that has not changed is walked through once.

    Raises
    ------
    DataFileError
        If something in it leads to another file, claims more than the file can hold, or breaks the library.
    """
    key = _key(path)
    if key not in _inspected:
        try:
            tried(path, problem)
            _inspected[key] = ""
        except DataFileError as error:
            _inspected[key] = str(error)
    if _inspected[key]:
        raise DataFileError(_inspected[key])


def inspect_all(paths: Sequence[Path]) -> None:
    """Walk through many files, several in one process, so that `inspect` knows them already.

    Where such a process breaks, its files are left to `inspect`, each by itself.
    """
    for first in range(0, len(paths), AT_ONCE):
        batch = [path for path in paths[first : first + AT_ONCE] if path.is_file()]
        if not batch:
            continue
        with suppress(DataFileError, OSError):
            keys = [_key(path) for path in batch]
            _inspected.update(zip(keys, tried(batch[0], problems, *map(str, batch[1:])), strict=True))


def inspected_elsewhere(path: Path) -> None:
    """Take a file as walked through: another process of this program was, and found nothing wrong with it."""
    _inspected.setdefault(_key(path), "")


def _key(path: Path) -> tuple[str, int, int, int]:
    stat = path.stat()
    return str(path.absolute()), stat.st_ino, stat.st_size, stat.st_mtime_ns


def problems(*paths: str) -> list[str]:
    """Return for each file what is wrong with it; empty where nothing is."""
    found = []
    for path in paths:
        try:
            problem(path)
            found.append("")
        except DataFileError as error:
            found.append(str(error))
    return found


def problem(path: str) -> None:
    """Raise DataFileError for what is wrong with a file; one that cannot be opened is left to the caller."""
    try:
        file = hdf5_file(path, "r")
    except OSError:
        return
    try:
        with file:
            for place, group, depth in _groups(path, file):
                if depth > DEPTH:
                    raise _refused(path, place, f"lies more than {DEPTH} groups deep")
                _attributes(path, place, group)
    except _UNREADABLE as error:  # of the groups themselves: there is nothing without them
        raise DataFileError(f"{path} is damaged: {error}; copy it again") from error


def _refused(path: str, place: str, what: str) -> DataFileError:
    return DataFileError(f"{path} is refused: {place} {what}. The file was not read; see docs/threats.md")


def _groups(path: str, file: h5py.File) -> Iterator[tuple[str, h5py.Group, int]]:
    """Yield all groups of a file once, after looking at their links and datasets."""
    waiting: list[tuple[str, h5py.Group, int]] = [("", file, 0)]
    seen = {h5py.h5o.get_info(file.id).addr}
    while waiting:
        prefix, group, depth = waiting.pop()
        yield prefix or "/", group, depth
        for name in _names(path, prefix, group):
            place = f"{prefix}/{in_a_line(name.decode('utf-8', 'replace'))}"
            address = _address(path, place, group, name)
            if address is None or address in seen:
                continue
            seen.add(address)
            if len(seen) > OBJECTS:
                raise _refused(path, prefix, f"and the rest hold more than {OBJECTS} objects")
            with suppress(*_UNREADABLE):  # what cannot be opened is left to who needs it
                found = h5py.h5o.open(group.id, name)
                if isinstance(found, h5py.h5g.GroupID):
                    waiting.append((place, h5py.Group(found), depth + 1))
                elif isinstance(found, h5py.h5d.DatasetID):
                    with suppress(*_UNREADABLE):
                        _dataset(path, place, found)
                    _attributes(path, place, h5py.Dataset(found))


def _names(path: str, place: str, group: h5py.Group) -> list[bytes]:
    if group.id.get_num_objs() > OBJECTS:
        raise _refused(path, place or "/", f"has more than {OBJECTS} members")
    try:
        return list(group.id)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise DataFileError(
            f"{path} is damaged: the members of {place or '/'} cannot be listed ({error}); copy it again"
        ) from None


def _address(path: str, place: str, group: h5py.Group, name: bytes) -> int | None:
    """Return where a named object lies, None for another name of one; refuse what leads out of the file.

    The link is asked: to ask the object would walk the index of its chunks, and fail where that is damaged.
    """
    try:
        link = group.id.links.get_info(name)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise DataFileError(f"{path} is damaged: {place} cannot be found ({error}); copy it again") from None
    if link.type == h5py.h5l.TYPE_HARD:
        return int(link.u)
    if link.type == h5py.h5l.TYPE_SOFT:  # another name of what is in the file, or of nothing
        return None
    raise _refused(path, place, "is a link to another file")


def _attributes(path: str, place: str, owner: Any) -> None:
    """Refuse attributes that are too many, too large or cannot be opened.

    They are looked up by name, too, as readers do it: where none can be opened, that may go round for ever.
    One whose value cannot be read is left to who needs it. One that cannot be opened hides others, whose
    values may crash a reader that finds them by name.
    """
    with suppress(*_UNREADABLE):
        owner.attrs.get(SOUGHT)
    try:
        count = h5py.h5a.get_num_attrs(owner.id)
        if count > ATTRIBUTES:
            raise _refused(path, place, f"has more than {ATTRIBUTES} attributes")
        opened = [h5py.h5a.open(owner.id, index=number) for number in range(count)]
    except _UNREADABLE as error:
        raise DataFileError(
            f"{path} is damaged: an attribute of {place} cannot be opened ({error}); copy it again"
        ) from None
    for attribute in opened:
        with suppress(*_UNREADABLE):
            name = attribute.name.decode("utf-8", "replace")
            shown = f"{place}@{in_a_line(name)}"
            if attribute.get_storage_size() > TEXT_BYTES:
                raise _refused(path, shown, f"has more than {TEXT_BYTES} bytes")
            value = owner.attrs[name]
            if isinstance(value, str | bytes) and len(value) > TEXT_BYTES:
                raise _refused(path, shown, f"has more than {TEXT_BYTES} bytes")


def _dataset(path: str, place: str, dataset: h5py.h5d.DatasetID) -> None:
    """Refuse a dataset whose values lie in other files, or that claims more than it can hold."""
    plist = dataset.get_create_plist()
    if plist.get_external_count():
        raise _refused(path, place, "keeps its values in another file")
    if plist.get_layout() == h5py.h5d.VIRTUAL:
        raise _refused(path, place, "is put together from other files (a virtual dataset)")
    if dataset.rank > AXES:
        raise _refused(path, place, f"has {dataset.rank} axes, more than {AXES}")
    filters = [plist.get_filter(number)[0] for number in range(plist.get_nfilters())]
    unknown = [number for number in filters if number not in FILTERS]
    if unknown or len(set(filters)) < len(filters):
        raise _refused(
            path,
            place,
            f"is compressed with the filters {filters}; known are {', '.join(FILTERS.values())}, each once. "
            "Compress it again with h5repack -f GZIP=1",
        )
    whole_bytes = prod(dataset.shape) * dataset.get_type().get_size()
    text = any(map(dataset.get_type().detect_class, (h5py.h5t.VLEN, h5py.h5t.STRING, h5py.h5t.REFERENCE)))
    if text and whole_bytes > TEXT_BYTES:
        raise _refused(path, place, f"claims {whole_bytes} bytes of text")
    if plist.get_layout() == h5py.h5d.CHUNKED:
        _chunks(path, place, dataset, plist.get_chunk(), filters, text=text)
    elif not text and dataset.get_storage_size() not in {0, whole_bytes}:
        raise _refused(
            path, place, f"claims {whole_bytes} bytes, but {dataset.get_storage_size()} are stored"
        )
    if text or not {3, 32000}.isdisjoint(filters):  # what the library alone can unpack
        _read_all(dataset)


def _chunks(
    path: str,
    place: str,
    dataset: h5py.h5d.DatasetID,
    chunk: tuple[int, ...],
    filters: list[int],
    *,
    text: bool,
) -> None:
    """Refuse chunks that are too large, or say that they hold more than can be packed into what is stored.

    Numbers that are not packed take as many bytes as they have; texts have other sizes in a file.
    """
    chunk_bytes = prod(chunk) * dataset.get_type().get_size()
    if chunk_bytes > CHUNK_BYTES:
        raise _refused(path, place, f"has chunks of {chunk_bytes} bytes, more than {CHUNK_BYTES}")
    packed = not _PACKING.isdisjoint(filters)

    def holds(info: Any) -> None:
        most = info.size * PACKED if packed else info.size
        largest = 2 * chunk_bytes + 1024 if filters or text else chunk_bytes
        if most < chunk_bytes or info.size > largest:
            raise _refused(
                path, place, f"has a chunk of {info.size} bytes that claims to hold {chunk_bytes} bytes"
            )

    try:
        dataset.chunk_iter(holds)
    except (OSError, RuntimeError, KeyError, ValueError):
        # a killed writer leaves an index that knows chunks which never came: those before them are good
        for offset in islice(_offsets(dataset.shape, chunk), OBJECTS):
            with suppress(OSError, RuntimeError, KeyError, ValueError):
                info = dataset.get_chunk_info_by_coord(offset)
                if info.byte_offset is not None:
                    holds(info)


def _offsets(shape: tuple[int, ...], chunk: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yield where the chunks of a dataset begin, in order."""
    return product(*(range(0, size, step) for size, step in zip(shape, chunk, strict=True)))


def _read_all(dataset: h5py.h5d.DatasetID) -> None:
    """Read a dataset, a chunk or a row at a time: only whether the library survives it is of interest."""
    values = h5py.Dataset(dataset)
    if values.ndim == 0:
        values[()]
        return
    step = values.chunks[0] if values.chunks else len(values)
    for start in range(0, len(values), max(1, step)):
        values[start : start + step]
