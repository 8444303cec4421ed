"""Imaging: photon counts and geometry in, images out. Arrays only; no hardware, no files.

What most programs need is here; it is imported when it is first used.

- `Capture` and `ArrayHistograms`: photon counts, and where and when they were taken;
- `VirtualPulse`, `VoxelGrid` and `Window`: how they are imaged;
- `ConfocalCamera`, `PhotoCamera` and `TransientCamera`: what the virtual camera shows;
- `image` and `video`: what makes an `Image`;
- `depth_map` and `measures`: what is read off an image.

Failures that a person can mend are `recon.errors.ReconError`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from recon import measures
    from recon.camera import ConfocalCamera, PhotoCamera, TransientCamera
    from recon.capture import ArrayHistograms, Capture
    from recon.depth import depth_map
    from recon.errors import ReconError
    from recon.filming import video
    from recon.grid import VoxelGrid
    from recon.imaging import image
    from recon.result import Image
    from recon.wave import VirtualPulse
    from recon.window import Window

__all__ = [
    "ArrayHistograms",
    "Capture",
    "ConfocalCamera",
    "Image",
    "PhotoCamera",
    "ReconError",
    "TransientCamera",
    "VirtualPulse",
    "VoxelGrid",
    "Window",
    "depth_map",
    "image",
    "measures",
    "video",
]

#: The module that each name is in; a module of its own is not listed.
_MODULES = {
    "ArrayHistograms": "capture",
    "Capture": "capture",
    "ConfocalCamera": "camera",
    "Image": "result",
    "PhotoCamera": "camera",
    "ReconError": "errors",
    "TransientCamera": "camera",
    "VirtualPulse": "wave",
    "VoxelGrid": "grid",
    "Window": "window",
    "depth_map": "depth",
    "image": "imaging",
    "video": "filming",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for; heavy libraries come with it, not before."""
    if name == "measures":
        return import_module("recon.measures")
    if name in _MODULES:
        return getattr(import_module(f"recon.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'recon' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
