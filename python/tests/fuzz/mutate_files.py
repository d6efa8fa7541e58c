"""Spoils what is inside files that are packed or have a structure: ``.npy``, ``.npz``, ``.gz``, HDF5. The packing itself stays right."""

from __future__ import annotations

import gzip
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mutate_bytes import Rng, spoil

Array = np.ndarray[Any, Any]
ODD_VALUES = (0.0, -0.0, -1.0, 1.0, 0.5, 1e-300, 1e300, 1e-9, 2.0**31, np.nan, np.inf, -np.inf)
DTYPES = ("f2", "f4", ">f8", "i1", "u1", "i4", "i8", "u8", "?", "c16", "S3", "U2", "M8[s]", "V4", "O", "i4,f4", "g")


def odd_array(rng: Rng, array: Array) -> Array:
    """The same with odd values, another shape, another type, or less of it."""
    array, choice = np.array(array), int(rng.integers(10))
    if choice <= 2 and array.size and array.dtype.kind in "fiu":
        flat = array.reshape(-1)
        places = rng.integers(0, flat.size, int(rng.integers(1, 4)))
        if array.dtype.kind == "f":
            flat[places] = rng.choice(ODD_VALUES, len(places))
        else:
            limits = np.iinfo(array.dtype)
            odd = [0, 1, limits.max, limits.min, min(flat.size, limits.max), limits.max // 2]
            flat[places] = rng.choice(np.array(odd, array.dtype), len(places))
        return array
    if choice == 3:
        return array[: int(rng.integers(0, len(array) + 1))] if array.ndim else array.reshape(1)
    if choice == 4:
        return np.concatenate([array, array]) if array.ndim else np.repeat(array, 3)
    if choice == 5:
        shapes = [(-1,), (1, -1), (-1, 1), (1, 1, -1), (*array.shape, 1), (0,), (0, 3), (), array.shape[::-1]]
        shape = shapes[int(rng.integers(len(shapes)))]
        return np.zeros(shape, array.dtype) if 0 in shape or not shape else array.reshape(shape)
    if choice == 6:
        return array.reshape(-1)[: int(rng.integers(0, 4))].reshape(-1)
    if choice == 7 and array.ndim:
        axis = int(rng.integers(array.ndim))
        return np.delete(array, 0, axis=axis) if array.shape[axis] else array
    if choice == 8:
        return array[..., :0] if array.ndim else array
    try:
        return array.astype(DTYPES[int(rng.integers(len(DTYPES)))])
    except (TypeError, ValueError):
        return array.astype("S8")


def _npy(array: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def spoil_npy(rng: Rng, data: bytes) -> bytes:
    """Another array, or the bytes of the file."""
    if rng.random() < 0.5:
        return spoil(rng, data)
    return _npy(odd_array(rng, np.load(io.BytesIO(data), allow_pickle=False)))


def spoil_npz(rng: Rng, data: bytes) -> bytes:
    """Another array of that name, one too few or too many, spoilt bytes in one; or the bytes of the archive."""
    if rng.random() < 0.2:
        return spoil(rng, data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for _ in range(int(rng.integers(1, 3))):
        name = str(rng.choice(sorted(members)))
        choice = rng.random()
        if choice < 0.1 and len(members) > 1:
            del members[name]
        elif choice < 0.2:
            members[name] = members[str(rng.choice(sorted(members)))]
        elif choice < 0.4:
            members[name] = spoil(rng, members[name])
        else:
            try:
                members[name] = _npy(odd_array(rng, np.load(io.BytesIO(members[name]), allow_pickle=False)))
            except Exception:  # spoilt already
                members[name] = spoil(rng, members[name])
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return file.getvalue()


def spoil_gzip(rng: Rng, data: bytes) -> bytes:
    """The text inside, or the packed bytes."""
    if rng.random() < 0.2:
        return spoil(rng, data)
    return gzip.compress(spoil(rng, gzip.decompress(data)), compresslevel=1)


def spoil_hdf5(rng: Rng, path: Path) -> None:
    """Changes the file in place: bytes, or a right file with wrong content, as another program may write it."""
    if rng.random() < 0.35:
        path.write_bytes(spoil(rng, path.read_bytes()))
        return
    with h5py.File(path, "r+") as file:
        for _ in range(int(rng.integers(1, 3))):
            names: list[str] = []
            file.visititems(lambda name, item, names=names: names.append(name))
            if names:
                _spoil_item(rng, file, names)


def _spoil_item(rng: Rng, file: h5py.File, names: list[str]) -> None:
    name, choice = names[int(rng.integers(len(names)))], rng.random()
    item = file[name]
    if choice < 0.15:
        del file[name]
    elif choice < 0.35:
        _spoil_attribute(rng, file if rng.random() < 0.6 else item)
    elif choice < 0.45:
        del file[name]
        kind = int(rng.integers(6))
        if kind == 0:
            file.create_group(name)
        elif kind == 1:
            file[name] = h5py.SoftLink("/nowhere")
        elif kind == 2:
            file[name] = h5py.ExternalLink("/dev/zero", "/")
        elif kind == 3:
            file[name] = "a text"
        elif kind == 4:
            file.create_dataset(name, (2**40,), "f8", chunks=(2**20,), compression="gzip")
        else:
            file[name] = file[names[int(rng.integers(len(names)))]] if names[0] in file else file["/"]
    elif isinstance(item, h5py.Dataset):
        attributes = dict(item.attrs)
        try:
            values = odd_array(rng, item[()])
            del file[name]
            new = file.create_dataset(name, data=values if values.dtype.kind not in "UMOg" else values.astype("S"))
        except (TypeError, ValueError):  # no such type in HDF5
            new = file.create_dataset(name, data=0.0) if name not in file else file[name]
        new.attrs.update(attributes)


def _spoil_attribute(rng: Rng, item: Any) -> None:
    names = sorted(item.attrs)
    if not names:
        item.attrs["rows"] = "strange"
        return
    name = names[int(rng.integers(len(names)))]
    value = item.attrs[name]
    choice = int(rng.integers(5))
    if choice == 0:
        del item.attrs[name]
    elif choice == 1:
        item.attrs[name] = [1.5, np.nan]
    elif choice == 2:
        item.attrs[name] = -3
    else:
        text = (
            value
            if isinstance(value, bytes)
            else value.encode()
            if isinstance(value, str)
            else json.dumps(np.asarray(value).tolist(), default=str).encode()
        )
        item.attrs[name] = np.bytes_(spoil(rng, text))
