"""Transport against an independent renderer: path-traced third-bounce light of two letters."""

import h5py
import numpy as np
import pytest

from simulators.constants import C_M_PER_S
from simulators.scenes import Mesh, Scene
from simulators.transport.patches import tessellate
from simulators.transport.renderer import Transport
from simulators.transport.three_bounces import ThreeBounces
from simulators.transport.visibility import occluders
from support.published import published


@pytest.fixture(scope="module")
def rendered():
    with h5py.File(published("rendered_letters_g32.h5")) as file:
        meshes = []
        for name in ("letter_R", "letter_D"):
            group = file["truth/geometry"][name]
            meshes.append(
                Mesh(name, group["vertices_m"][:].astype(float), group["faces"][:].astype(int), 0.8)
            )
        return {
            "scene": Scene("rendered", tuple(meshes)),
            "transient": file["transient"][:].astype(float),
            "laser_m": file["laser_position_m"][:].astype(float),
            "detector_m": file["detector_position_m"][:].astype(float),
            "time_s": file["time_s"][:],
            "truth": [file["truth"][key][:].astype(float) for key in ("x_m", "y_m", "depth_m")],
        }


@pytest.fixture(scope="module")
def expected(rendered):
    built, time_s = rendered["scene"], rendered["time_s"]
    half_s = (time_s[1] - time_s[0]) / 2
    edges_s = np.append(time_s - half_s, time_s[-1] + half_s)
    return Transport.of_scene(built).transients(rendered["laser_m"], rendered["detector_m"], edges_s)


def correlation(a, b):
    return (a * b).sum(axis=-1) / np.sqrt((a**2).sum(axis=-1) * (b**2).sum(axis=-1))


def test_transients_agree(rendered, expected):
    """The rendered record is noisy by a few per cent a bin, which limits the likeness."""
    reference = rendered["transient"]
    assert correlation(expected.ravel(), reference.ravel()) > 0.99
    assert correlation(expected, reference).min() > 0.97
    for shift in (-1, 1):  # not a bin early or late
        shifted = np.roll(expected, shift, axis=1)
        assert correlation(shifted.ravel(), reference.ravel()) < 0.97


def test_energy_of_every_position_agrees(rendered, expected):
    scale = rendered["transient"].sum() / expected.sum()
    ratio = rendered["transient"].sum(axis=1) / expected.sum(axis=1) / scale
    assert ratio.std() < 0.02
    assert np.abs(ratio - 1).max() < 0.06


def test_share_of_the_near_letter_agrees(rendered, expected):
    """Where all light of R arrives before any of D, time tells the letters apart."""
    built, time_s = rendered["scene"], rendered["time_s"]
    patches = tessellate(built)
    three = ThreeBounces(patches, occluders(built.triangles_m), tuple(rendered["detector_m"][0]))
    near = patches.triangle < len(built.meshes[0].faces)
    shares = []
    for index in range(0, len(expected), 7):
        weight, path_m = three.from_spot(tuple(rendered["laser_m"][index]))
        last_s = path_m[near & (weight > 0)].max() / C_M_PER_S
        first_s = path_m[~near & (weight > 0)].min() / C_M_PER_S
        if first_s - last_s > 0.1e-9:
            before = time_s < (first_s + last_s) / 2
            shares.append(
                [h[index][before].sum() / h[index].sum() for h in (expected, rendered["transient"])]
            )
    ours, theirs = np.array(shares).T
    assert len(shares) > 50
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)
    assert np.abs(ours - theirs).max() < 0.03


def test_depth_map_agrees(rendered):
    """Pixels whose centre falls on an outline may go either way: fewer than 1 in 200."""
    x_m, y_m, depth_m = rendered["truth"]
    ours = rendered["scene"].depth_map(x_m, y_m)
    differs = np.isfinite(ours) != np.isfinite(depth_m)
    both = np.isfinite(ours) & np.isfinite(depth_m)
    assert differs.mean() < 0.005
    assert (np.abs(ours - depth_m)[both] < 0.005).mean() > 0.995  # plates are 4 mm thick
