"""The picture and the video of a volume, the fall-off of its intensity undone."""

import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from recon.depth import compensate_falloff
from recon.filming import FRAMES_PER_PULSE
from rig.files.volume import Volume
from rig.image.request import Request
from rig.show.sheet import frames_figure, lit, refocus_figure
from rig.show.video import save_video
from rig.show.volume import volume_figure

#: Power of depth, or of time since the flash, with which pictures undo the fall-off of the intensity.
FALLOFF = 4.0


def picture(volume: Volume) -> Figure:
    """Draw a volume as `rig recon` does; of a video of all depths, the brightest depth of each pixel."""
    if volume.t_s is not None and volume.intensity.ndim == 4:
        volume = dataclasses.replace(volume, intensity=volume.intensity.max(axis=1))
    if volume.t_s is not None:
        return frames_figure(_seen(volume), compensation=_compensation(volume))
    if volume.parameters.get("camera") == "photo":
        return refocus_figure(volume)
    return volume_figure(_seen(volume), compensation=_compensation(volume))


def save_film(volume: Volume, request: Request, path: Path) -> None:
    """Write a film; one of light that was not told its moments begins and ends where the light does."""
    shown = _seen(volume)
    if not request.each_frame and request.frames_s is None:
        shown = lit(shown, margin=FRAMES_PER_PULSE)
    save_video(shown, path, compensation=_compensation(volume))


def _seen(volume: Volume) -> Volume:
    """Compensate the fall-off, so that far objects are seen beside near ones: with depth, or with time."""
    if volume.parameters.get("each_frame"):
        return volume  # front views, of which it was done plane by plane
    if volume.t_s is None:
        return dataclasses.replace(
            volume, intensity=compensate_falloff(volume.intensity, volume.z_m, _falloff(volume))
        )
    rise = (np.maximum(volume.t_s, 0) / volume.t_s[-1]) ** FALLOFF
    return dataclasses.replace(volume, intensity=volume.intensity * rise.astype(np.float32)[:, None, None])


def _compensation(volume: Volume) -> str:
    """Say what the intensity of pictures is multiplied with."""
    if volume.t_s is not None and not volume.parameters.get("each_frame"):
        return "t⁴"
    return "z⁴" if _falloff(volume) else ""


def _falloff(volume: Volume) -> float:
    return float(volume.parameters.get("falloff_power", FALLOFF))
