"""Attributes of recordings: texts have a fixed length. What has not is kept in a heap, which libhdf5 does not read safely
if it is damaged.
"""

from __future__ import annotations

import json
from typing import Any

import h5py
import numpy as np

from quasirigid.errors import InvalidValueError


def write_attribute(item: Any, name: str, value: Any) -> None:
    """Write a text, a number, an array of numbers, a list of texts, or a dict (as JSON) as attribute ``name`` of a file or dataset.

    Texts are UTF-8, of exactly their length in bytes. Raises ``InvalidValueError`` for anything else.
    """
    data = as_array(name, value)
    kind = h5py.string_dtype("utf-8", data.dtype.itemsize) if data.dtype.kind == "S" else None
    item.attrs.create(name, data, dtype=kind)


def as_array(name: str, value: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """The value of an attribute as HDF5 gets it. Raises ``InvalidValueError`` for what an attribute cannot hold."""
    hint = "give a text, a number, an array of numbers, a list of texts or a dict"
    if isinstance(value, dict):
        value = as_json(name, value)
    if isinstance(value, list | tuple) and value and all(isinstance(text, str) for text in value):
        texts = [_encoded(name, text) for text in value]
        return np.array(texts, f"S{max(1, *map(len, texts))}")
    if isinstance(value, str):
        text = _encoded(name, value)
        return np.array(text, f"S{max(1, len(text))}")
    try:
        data = np.asarray(value)
    except ValueError as error:
        raise InvalidValueError(f"attribute {name}", "a text or numbers", error, hint) from None
    if data.dtype.kind not in "fiub":
        raise InvalidValueError(f"attribute {name}", "a text or numbers", f"{value!r:.60}", hint)
    return data


def as_json(name: str, value: Any) -> str:
    """A dict or a list as JSON. Raises ``InvalidValueError`` for what JSON cannot hold."""
    try:
        return json.dumps(value)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidValueError(f"attribute {name}", "what JSON can hold", error, "give texts, numbers, lists and dicts of them") from None


def _encoded(name: str, text: str) -> bytes:
    try:
        encoded = text.encode()
    except UnicodeEncodeError as error:
        raise InvalidValueError(f"attribute {name}", "a text that can be written as UTF-8", error, "replace that character") from None
    if b"\0" in encoded:
        raise InvalidValueError(f"attribute {name}", "a text without the character NUL", repr(text[:60]), "leave it out")
    return encoded


__all__ = ["as_array", "as_json", "write_attribute"]
