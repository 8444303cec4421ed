"""Files of several layouts, written as other programs write them, with whatever is to be different."""

import h5py
import numpy as np
import scipy.io


def matlab(path, version, **variables):
    """Write variables as MATLAB v5, or as v7.3, which HDF5 shows with its axes reversed."""
    path.unlink(missing_ok=True)
    if version == 5:
        scipy.io.savemat(path, variables)
        return
    with h5py.File(path, "w") as file:
        for name, value in variables.items():
            file[name] = np.atleast_2d(value).T


def znlos(path, shape, turned, grids=("camera", "laser")):
    """Write a file with a place of its own for each point, or everything with its axes reversed."""
    rng = np.random.default_rng(5)
    variables = {"data": rng.random(shape).astype("f4"), "deltaT": 0.003, "t0": 1.2}
    sizes = {"camera": shape[3:5], "laser": shape[5:7] or shape[3:5]}
    for side, (nx, ny) in sizes.items():
        # in the plane z = 0; the laser's points lie between the camera's
        shift = 0.0 if side == "camera" or len(shape) == 5 else 0.013
        x_m, y_m = np.meshgrid(0.1 * np.arange(nx) + shift, 0.07 * np.arange(ny) - shift, indexing="ij")
        variables[f"{side}GridPositions"] = np.stack([x_m, y_m, 0 * x_m])
        variables[f"{side}GridNormals"] = np.stack([0 * x_m, 0 * x_m, 0 * x_m + 1])
    heads = {"cameraPosition": np.array([0.2, 0.3, 1.5]), "laserPosition": np.array([-0.3, 0.1, 1.1])}
    path.unlink(missing_ok=True)
    with h5py.File(path, "w") as file:
        for name, value in (variables | heads).items():
            file[name] = np.transpose(value) if turned else value
    return variables | heads


def lct(path, **changes):
    rng = np.random.default_rng(4)
    variables = {"rect_data": rng.poisson(2.0, (3, 4, 20)).astype(float), "width": 0.5}
    scipy.io.savemat(path, variables | changes)
    return path


def liu2019(path, transposed=True, **changes):
    """Write the group ``dataset`` as MATLAB v7.3 shows it: points as columns, or as rows."""
    rng = np.random.default_rng(9)
    spots_m = np.column_stack(
        [np.tile(np.linspace(-0.9, 0.9, 5), 3), np.repeat([-0.5, 0.0, 0.5], 5), np.zeros(15)]
    )
    variables = {
        "data": rng.poisson(1.0, (30, 1, 15)).astype(float),
        "laserPos": spots_m,
        "cameraPos": np.array([[0.1, 0.2, 0.0]]),
        "laserNorm": np.tile([0.0, 0.0, 1.0], (15, 1)),
        "laserOrigin": np.array([[-0.4], [0.1], [2.0]]),
        "cameraOrigin": np.array([[0.3], [0.2], [2.2]]),
        "deltat": np.array([[0.0012]]),
        "t0": np.array([[4.5]]),
        "t": np.array([[30.0]]),
    } | changes
    with h5py.File(path, "w") as file:
        for key, value in variables.items():
            points = key.endswith(("Pos", "Norm")) and transposed
            file[f"dataset/{key}"] = value.T if points else value
        file["minimalpos"] = np.zeros((3, 1))
    return variables


def tal(path, *, legs=False, confocal=False, flat=False, turn=None, normals=True, move=(0, 0, 0), **changes):
    """Write a file as y-tal does: enums of shape (1,), None as an empty dataset, metres for time."""
    turn = np.eye(3) if turn is None else turn
    x_m, y_m = np.meshgrid(np.linspace(-0.5, 0.5, 3), np.linspace(-0.4, 0.4, 4), indexing="ij")
    grid_m = np.stack([x_m, y_m, 0 * x_m], axis=-1) @ turn.T + move
    signal = np.random.default_rng(8).random((20, 3, 4), "f4")
    if flat:
        grid_m, signal = grid_m.reshape(-1, 3), signal.reshape(20, -1)
    variables = {
        "H": signal,
        "H_format": ("HFormat", {"T_Sx_Sy": 1, "T_Si": 3}, 3 if flat else 1),
        "sensor_xyz": np.array([0.1, 0.2, 1.5]) @ turn.T + move,
        "sensor_grid_xyz": grid_m,
        "sensor_grid_normals": np.broadcast_to(turn[:, 2], grid_m.shape) if normals else None,
        "sensor_grid_format": ("GridFormat", {"N_3": 1, "X_Y_3": 2}, 1 if flat else 2),
        "laser_xyz": np.array([-0.3, 0.1, 1.2]) @ turn.T + move,
        "laser_grid_xyz": grid_m if confocal else (np.array([[[0.05, -0.1, 0.0]]]) @ turn.T + move),
        "laser_grid_normals": None,
        "laser_grid_format": ("GridFormat", {"N_3": 1, "X_Y_3": 2}, 2),
        "volume_format": None,
        "delta_t": 0.003,
        "t_start": 1.5,
        "t_accounts_first_and_last_bounces": legs,
        "scene_info": "original_format: none\n",
    } | changes
    with h5py.File(path, "w") as file:
        for key, value in variables.items():
            if value is None:
                file[key] = h5py.Empty(float)
            elif isinstance(value, tuple):
                dataset = file.create_dataset(key, (1,), h5py.enum_dtype(value[1], basetype="i"))
                dataset[0] = value[2]
            else:
                file[key] = value
    return variables
