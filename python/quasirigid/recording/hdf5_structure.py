"""What is in an HDF5 file, found out in a process of its own: names, types, shapes, attributes, and where the bytes of every dataset are.

A damaged file can keep libhdf5 busy for ever inside one call, where no signal handler of Python runs, can take all memory, or can crash it.
So ``recording.file`` runs this file as a program, with limits of time and memory, and reads the bytes itself. It imports nothing of the
package: starting takes as long as importing h5py.

    python hdf5_structure.py FILE CPU_SECONDS MEMORY_BYTES SYS_PATH_AS_JSON

Written to standard output: one line of JSON, and then the chunk tables of the datasets, one after another. A chunk table is int64 and has
one row per chunk: its first element in the dataset (one number per dimension), filter mask, address in the file and size, both in bytes.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from contextlib import suppress
from typing import Any

READ_ATTEMPTS = 28
"""How often HDF5 reads again what does not have its checksum, in case it is just being written: every pause is twice the one before, 0.3 s
in all. Its own 100 attempts would never come to an end in a file that is damaged.
"""
ATTRIBUTE_BYTES = 2**26
"""Largest attribute that is read. The longest one of a recording describes its bodies: some 200 bytes each."""
SHUFFLE, GZIP = 2, 1
"""Filters as HDF5 counts them."""


class RefusedError(Exception):
    """Something that no recording has: where, what was expected, what came."""


def limit(cpu_seconds: int, memory: int) -> None:
    """End this process when it has computed for so long; let it have no more address space than so many bytes."""
    if sys.platform == "win32":
        return  # the parent process watches the time alone
    import resource

    limits = {resource.RLIMIT_CPU: (cpu_seconds, cpu_seconds + 1), resource.RLIMIT_CORE: (0, 0), resource.RLIMIT_AS: (memory, memory)}
    for which, values in limits.items():
        with suppress(ValueError, OSError):  # it has a lower one already; macOS knows no limit of address space
            resource.setrlimit(which, values)


def opened(path: str) -> Any:
    """The file, as one that may still be written. Raises ``OSError`` where it cannot be opened."""
    import h5py

    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    with suppress(AttributeError):  # h5py does not offer it, and on Windows it cannot be found through h5py
        set_attempts = ctypes.CDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        set_attempts.argtypes = (ctypes.c_int64, ctypes.c_uint)
        set_attempts(access.id, READ_ATTEMPTS)
    return h5py.File(h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ, fapl=access))


def attributes_of(item: Any, name: str) -> dict[str, Any]:
    """Attributes as JSON has them: texts, numbers, lists of texts, and arrays of numbers as ``{"dtype", "shape", "values"}``."""
    import h5py
    import numpy as np

    found: dict[str, Any] = {}
    for key in item.attrs:
        where = f"attribute {key} of {name or 'the file'}"
        size = h5py.h5a.open(item.id, key.encode()).get_storage_size()
        if size > ATTRIBUTE_BYTES:
            raise RefusedError(where, f"at most {ATTRIBUTE_BYTES:,} bytes", f"{size:,}")
        value = item.attrs[key]
        if isinstance(value, bytes):
            found[key] = value.decode(errors="replace")
        elif isinstance(value, str):
            found[key] = value
        elif isinstance(value, np.ndarray) and value.dtype.kind in "SO":
            texts = [text.decode(errors="replace") if isinstance(text, bytes) else text for text in value.ravel().tolist()]
            if not all(isinstance(text, str) for text in texts):
                raise RefusedError(where, "texts or numbers", f"an array of {value.dtype}")
            found[key] = texts
        elif isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "fiub":
            plain = value.ravel().tolist()
            shape = list(value.shape)
            found[key] = {"dtype": value.dtype.str, "shape": shape, "values": plain} if shape else plain[0]
        else:
            raise RefusedError(where, "a text, a number or an array of them", type(value).__name__)
    return found


def dataset(item: Any, name: str) -> tuple[dict[str, Any], Any]:
    """What there is to know about a dataset, and its chunk table."""
    import h5py
    import numpy as np

    kind = item.id.get_type()
    if not isinstance(kind, h5py.h5t.TypeStringID | h5py.h5t.TypeFloatID | h5py.h5t.TypeIntegerID | h5py.h5t.TypeEnumID):
        raise RefusedError(name, "numbers, or texts of a fixed length", str(item.dtype))
    if isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str():
        raise RefusedError(name, "numbers, or texts of a fixed length", "texts of variable length")
    if not isinstance(kind, h5py.h5t.TypeStringID) and not h5py.h5t.py_create(item.dtype).equal(kind):
        raise RefusedError(name, "numbers in one of the usual formats", str(item.dtype))
    if item.is_virtual or item.external:
        raise RefusedError(name, "data in the file itself", "data in other files (virtual, or in external storage)")
    if item.shape is None:
        raise RefusedError(name, "an array", "a dataset without any values")
    plan = item.id.get_create_plist()
    filters = [plan.get_filter(i)[0] for i in range(plan.get_nfilters())]
    if filters not in ([], [GZIP], [SHUFFLE], [SHUFFLE, GZIP]):
        names = ", ".join(os.fsdecode(plan.get_filter(i)[3]) or str(plan.get_filter(i)[0]) for i in range(len(filters)))
        raise RefusedError(name, "no other filters than shuffle and gzip", names)
    about = {"name": name, "dtype": item.dtype.str, "shape": list(item.shape), "attributes": attributes_of(item, name)}
    about |= {"filters": filters, "chunk": None, "chunks": 0, "address": None, "values": None}
    table: list[tuple[int, ...]] = []
    layout = plan.get_layout()
    if layout == h5py.h5d.CHUNKED:
        about["chunk"] = list(item.chunks)
        item.id.chunk_iter(lambda chunk: table.append((*chunk.chunk_offset, chunk.filter_mask, chunk.byte_offset, chunk.size)))
        about["chunks"] = len(table)
    elif layout == h5py.h5d.CONTIGUOUS:
        about["address"] = item.id.get_offset()
    elif layout == h5py.h5d.COMPACT:  # in the head of the dataset, which has 64 kB at most
        about["values"] = item[()].tobytes().hex()
    else:
        raise RefusedError(name, "data that are chunked, contiguous or compact", f"layout {layout}")
    return about, np.array(table, "<i8").reshape(len(table), len(item.shape) + 3)


def structure(path: str) -> tuple[dict[str, Any], list[Any]]:
    """Everything that there is to know about the file, and the chunk tables of its datasets."""
    import h5py

    before = os.stat(path)
    with opened(path) as file:
        if file.userblock_size:
            raise RefusedError("the file", "one that begins with its own head", f"{file.userblock_size} bytes before it")
        links: list[tuple[str, int]] = []
        file.id.links.visit(lambda name, link: links.append((os.fsdecode(name), link.type)), info=True)
        for name, link in links:
            if link != h5py.h5l.TYPE_HARD:
                raise RefusedError(name, "data in the file itself", "a link to somewhere else")
        items = [(name, file[name]) for name, _ in links]
        datasets = [dataset(item, name) for name, item in items if isinstance(item, h5py.Dataset)]
        for name, item in items:
            if not isinstance(item, h5py.Dataset | h5py.Group):
                raise RefusedError(name, "a dataset or a group", type(item).__name__)
        about = {"attributes": attributes_of(file, ""), "datasets": [which for which, _ in datasets]}
    return about | {"file": [before.st_dev, before.st_ino]}, [table for _, table in datasets]


def main(path: str, cpu_seconds: str, memory: str, sys_path: str) -> None:
    """Write what is in the file at ``path`` to standard output, or what is wrong with it."""
    limit(int(cpu_seconds), int(memory))
    sys.path[:] = json.loads(sys_path)
    import h5py  # noqa: F401  # without enough memory it ends here

    tables: list[Any] = []
    about: dict[str, Any]
    try:
        about, tables = structure(path)
    except RefusedError as refused:
        about = {"refused": refused.args}
    except MemoryError:
        raise  # nothing is said of the file then
    except Exception as error:  # whatever HDF5 says of a damaged file
        about = {"error": " ".join(str(error).split()) or type(error).__name__}
    sys.stdout.buffer.write(json.dumps(about).encode() + b"\n")
    for table in tables:
        sys.stdout.buffer.write(table.tobytes())
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
