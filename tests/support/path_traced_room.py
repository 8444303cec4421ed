"""Render a room with mitransient: run as ``python path_traced_room.py ROOM.npz OUT.npz`` in its own process.

ROOM.npz holds triangles_m (T, 3, 3), albedo, roughness (1: Lambertian, below: partly a lobe of GGX), wall_m,
wall_albedo, laser_m (3,), edges_m (B + 1,), samples and bounces (N,); OUT.npz gets transient (N, spots, B) in
one arbitrary unit, and spots_m (spots, 3).
"""

import sys
import tempfile

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_mono")
import mitransient  # noqa: E402, F401  # registers its plugins in the chosen variant

COLUMNS, ROWS = 3, 2


def render(room, folder, bounces):
    """Transients (spots, B) of the light of exactly so many bounces."""
    edges_m, laser_m = room["edges_m"], room["laser_m"]
    scene = {
        "type": "scene",
        "integrator": {
            "type": "transient_nlos_path",
            "nlos_laser_sampling": True,
            "filter_bounces": bounces - 1,  # mitransient 1.3.1 does not count the laser spot it samples
            "max_depth": bounces + 2,
            "rr_depth": 100,
            "temporal_filter": "box",
        },
        "relay_wall": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale([*(room["wall_m"] / 2), 1]),
            "bsdf": {"type": "diffuse", "reflectance": float(room["wall_albedo"])},
            "sensor": {
                "type": "nlos_capture_meter",
                "sensor_origin": [0.0, 0.0, 0.3],
                "sampler": {"type": "independent", "sample_count": int(room["samples"])},
                "film": {
                    "type": "transient_hdr_film",
                    "width": COLUMNS,
                    "height": ROWS,
                    "temporal_bins": len(edges_m) - 1,
                    "start_opl": float(edges_m[0]),
                    "bin_width_opl": float(edges_m[1] - edges_m[0]),
                    "rfilter": {"type": "box"},
                },
            },
        },
        "laser": {
            "type": "projector",
            "fov": 0.2,
            "irradiance": 100.0,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=[*laser_m[:2], 0.3], target=laser_m.tolist(), up=[0, 1, 0]
            ),
        },
    }
    path = f"{folder}/room.obj"
    with open(path, "w") as file:
        file.writelines(f"v {x} {y} {z}\n" for x, y, z in room["triangles_m"].reshape(-1, 3))
        file.writelines(f"f {n + 1} {n + 2} {n + 3}\n" for n in range(0, 3 * len(room["triangles_m"]), 3))
    scene["room"] = {
        "type": "obj",
        "filename": path,
        "face_normals": True,
        "bsdf": {"type": "twosided", "bsdf": surface(float(room["albedo"]), float(room["roughness"]))},
    }
    _, transient = mi.render(mi.load_dict(scene), seed=bounces)
    return np.array(transient)[..., 0].reshape(COLUMNS * ROWS, -1)


def surface(albedo, roughness):
    """What the hidden surfaces reflect."""
    matt = {"type": "diffuse", "reflectance": albedo}
    if roughness == 1:
        return matt
    mirror = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": roughness}
    mirror["specular_reflectance"] = albedo
    return {"type": "blendbsdf", "weight": roughness, "mirror": mirror, "matt": matt}


def main(room_path, out_path):
    with np.load(room_path) as file:
        room = dict(file)
    with tempfile.TemporaryDirectory() as folder:
        transient = np.stack([render(room, folder, bounces) for bounces in room["bounces"].tolist()])
    u, v = np.meshgrid((np.arange(COLUMNS) + 0.5) / COLUMNS, (np.arange(ROWS) + 0.5) / ROWS)
    spots_m = np.stack([(u - 0.5) * room["wall_m"][0], (v - 0.5) * room["wall_m"][1], 0 * u], axis=-1)
    np.savez(out_path, transient=transient, spots_m=spots_m.reshape(-1, 3))


if __name__ == "__main__":
    main(*sys.argv[1:])
