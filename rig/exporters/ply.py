"""PLY of a volume's surface: binary, little-endian, with normals and colours.

Greg Turk, "The PLY polygon file format".
"""

from pathlib import Path

import numpy as np

from rig.exporters.surface import surface_mesh
from rig.files import Volume

NAME = "PLY, triangles"
ENDINGS = (".ply",)
_VERTEX = np.dtype([("place", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 3)])
_FACE = np.dtype([("corners", "u1"), ("vertices", "<i4", 3)])
_HEAD = """ply
format binary_little_endian 1.0
comment surface of {scan}, in metres: x, y on the relay wall, z its depth
element vertex {vertices}
property float x
property float y
property float z
property float nx
property float ny
property float nz
property uchar red
property uchar green
property uchar blue
element face {faces}
property list uchar int vertex_indices
end_header
"""


def write(path: Path, volume: Volume) -> None:
    """Write the file.

    Raises
    ------
    UsageError
        If the volume shows no surface.
    """
    mesh = surface_mesh(volume)
    vertices = np.empty(len(mesh.vertices_m), _VERTEX)
    vertices["place"], vertices["normal"], vertices["colour"] = mesh.vertices_m, mesh.normals, mesh.colours
    faces = np.empty(len(mesh.faces), _FACE)
    faces["corners"], faces["vertices"] = 3, mesh.faces
    name = " ".join(volume.scan.split()) or "a volume"
    head = _HEAD.format(scan=name, vertices=len(vertices), faces=len(faces))
    with path.open("wb") as file:
        file.write(head.encode("ascii", "backslashreplace"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())
