"""Packages and programs that only some verbs need."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from rig.install import install_extra
from rig.model.config import RigConfig
from rig.setup.doctor.finding import Finding

#: Endings of scenes that are meshes.
_MESHES = (".obj", ".ply", ".stl")


def _sees_its_wall(config: RigConfig) -> bool:
    return bool(config.cameras.addresses) and not config.simulated


def _has_a_mesh(config: RigConfig) -> bool:
    return config.simulation is not None and config.simulation.scene.lower().endswith(_MESHES)


def _never(config: RigConfig) -> bool:
    return False


@dataclass(frozen=True)
class _Extra:
    name: str
    module: str
    package: str
    used_for: str
    needed: Callable[[RigConfig], bool] = _never


_EXTRAS = (
    _Extra("cameras", "cv2", "opencv-python-headless", "rig calibrate galvo with cameras", _sees_its_wall),
    _Extra("mesh", "trimesh", "trimesh", "scenes and truths from mesh files", _has_a_mesh),
    _Extra("gpu", "torch", "torch", "rig recon --device cuda"),
    _Extra("web", "starlette", "starlette", "a web page to watch a scan from outside"),
    _Extra("cluster", "distributed", "distributed", "imaging on more than one computer"),
)


def check(config: RigConfig) -> Iterator[Finding]:
    """Return which are there; one that this rig needs and that is not there is missing."""
    for extra in _EXTRAS:
        yield _look_for(extra, config)
    found = shutil.which("ffmpeg")
    remedy = "" if found else "Install the program, and put it on the PATH: sudo apt install ffmpeg"
    yield Finding(
        "ffmpeg", "ok" if found else "optional", found or "not found; used for videos as .mp4", remedy
    )


def _look_for(extra: _Extra, config: RigConfig) -> Finding:
    if find_spec(extra.module):
        try:
            return Finding(extra.package, "ok", version(extra.package))
        except PackageNotFoundError:  # there under another name, such as opencv-python
            return Finding(extra.package, "ok", "installed")
    needed = extra.needed(config)
    words = f"not installed; {'this rig needs it' if needed else 'used'} for {extra.used_for}"
    return Finding(extra.package, "missing" if needed else "optional", words, install_extra(extra.name))
