"""Binary glTF 2.0 of a volume's surface, for browsers, slides and Blender.

Khronos, "glTF 2.0 specification", chapters 3 and 4. glTF is in metres and right-handed with y up, as we are.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rig
from rig.exporters.surface import surface_mesh
from rig.files import Volume

NAME = "glTF, triangles"
ENDINGS = (".glb",)
_FLOAT, _UINT, _UBYTE = 5126, 5125, 5121
_VERTICES, _INDICES = 34962, 34963  # what a piece of the buffer is for


def write(path: Path, volume: Volume) -> None:
    """Write the file.

    Raises
    ------
    UsageError
        If the volume shows no surface.
    """
    mesh = surface_mesh(volume)
    opaque = np.full((len(mesh.colours), 1), 255, np.uint8)
    arrays: list[tuple[NDArray, int, str, int]] = [
        (mesh.vertices_m.astype("<f4"), _FLOAT, "VEC3", _VERTICES),
        (mesh.normals.astype("<f4"), _FLOAT, "VEC3", _VERTICES),
        (np.hstack([mesh.colours, opaque]), _UBYTE, "VEC4", _VERTICES),
        (mesh.faces.astype("<u4").reshape(-1, 1), _UINT, "SCALAR", _INDICES),
    ]
    accessors, views, buffer = [], [], b""
    for number, (array, kind, shape, target) in enumerate(arrays):
        accessor: dict[str, Any] = {
            "bufferView": number,
            "componentType": kind,
            "count": len(array),
            "type": shape,
        }
        if number == 0:
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if kind == _UBYTE:
            accessor["normalized"] = True
        accessors.append(accessor)
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": array.nbytes, "target": target})
        buffer += array.tobytes()
    head = {
        "asset": {"version": "2.0", "generator": f"nlos-rig {rig.__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": volume.scan or "surface"}],
        "materials": [
            {"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}
        ],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0}
                ]
            }
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(buffer)}],
    }
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 4)
    pieces = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    )
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + len(pieces)))
        file.write(pieces)
