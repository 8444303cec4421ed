"""VTK image data (``.vti``): XML with the voxels appended raw, for ParaView and every other VTK program.

Point data on a uniform grid, x fastest, in metres of our frame: origin at the wall's centre, y up, z out of
the wall (VTK XML file formats, "ImageData").
"""

import struct
from pathlib import Path

import numpy as np

from rig.errors import UsageError
from rig.exporters.arrays import pitches_m
from rig.files import Volume

NAME = "VTK image data"
ENDINGS = (".vti",)

_HEAD = """<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">
    <Piece Extent="{extent}">
      <PointData Scalars="intensity">
        <DataArray type="Float32" Name="intensity" format="appended" offset="0"/>
      </PointData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
_"""


def write(path: Path, volume: Volume) -> None:
    """Write the file.

    Raises
    ------
    UsageError
        If the volume has a time axis, or is not evenly spaced.
    """
    if volume.t_s is not None:
        raise UsageError(
            "a volume with a time axis cannot be written as .vti; export it to .npz, .mat or .tif"
        )
    nz, ny, nx = volume.intensity.shape
    head = _HEAD.format(
        extent=f"0 {nx - 1} 0 {ny - 1} 0 {nz - 1}",
        origin=" ".join(repr(float(axis[0])) for axis in (volume.x_m, volume.y_m, volume.z_m)),
        spacing=" ".join(map(repr, pitches_m(volume))),
    )
    voxels = np.ascontiguousarray(volume.intensity, "<f4")
    with path.open("wb") as file:
        file.write(head.encode("ascii"))
        file.write(struct.pack("<Q", voxels.nbytes))
        file.write(voxels.data)
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")
