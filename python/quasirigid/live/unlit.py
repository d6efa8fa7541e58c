"""Flat colour for the page: triangles and hair lines as binary glTF 2.0 with the extension KHR_materials_unlit.

A large plane whose every point is as bright as any other needs no light; a page without a graphics card draws it in a third of the time.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import FloatArray, IntArray

LINES, TRIANGLES = 1, 4
_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963


def unlit_glb(points: FloatArray, elements: IntArray, colours: npt.NDArray[np.float32], *, see_through: bool = False) -> bytes:
    """A file of ``points`` (n, 3) m and ``elements``: triangles (m, 3), or lines (m, 2) one pixel wide. ``colours`` is one (3,) for all,
    or (n, 4) with opacity; red, green, blue from 0 to 1 in linear light.
    """
    places = points.astype("<f4")
    arrays: list[tuple[bytes, dict[str, Any], int]] = [
        (
            places.tobytes(),
            {
                "componentType": _FLOAT,
                "count": len(places),
                "type": "VEC3",
                "min": places.min(axis=0).tolist(),
                "max": places.max(axis=0).tolist(),
            },
            _VERTICES,
        ),
        (elements.astype("<u4").tobytes(), {"componentType": _UINT, "count": elements.size, "type": "SCALAR"}, _INDICES),
    ]
    attributes = {"POSITION": 0}
    base = [1.0, 1.0, 1.0, 1.0]
    if colours.ndim == 1:
        base = [*colours.tolist(), 1.0]
    else:
        arrays.append((colours.astype("<f4").tobytes(), {"componentType": _FLOAT, "count": len(colours), "type": "VEC4"}, _VERTICES))
        attributes["COLOR_0"] = 2
    starts = np.cumsum([0] + [len(data) for data, _, _ in arrays]).tolist()
    content = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": attributes,
                        "indices": 1,
                        "material": 0,
                        "mode": TRIANGLES if elements.shape[1] == 3 else LINES,
                    }
                ]
            }
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorFactor": base},
                "extensions": {"KHR_materials_unlit": {}},
                "alphaMode": "BLEND" if see_through else "OPAQUE",
            }
        ],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(data), "target": target}
            for start, (data, _, target) in zip(starts, arrays, strict=False)
        ],
        "accessors": [{"bufferView": i, **accessor} for i, (_, accessor, _) in enumerate(arrays)],
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data = b"".join(data for data, _, _ in arrays)  # of four-byte numbers alone: needs no padding
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
