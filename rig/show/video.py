"""A transient camera's video as a moving picture, drawn and written one frame at a time."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import GifImagePlugin, Image

from rig.atomic import appearing, refusals_told
from rig.files.volume import Volume
from rig.files.words import parameters_line
from rig.show.endings import check_video
from rig.show.sheet import film_colours, outline, stamp, video_amplitude, video_label
from rig.show.volume import draw_front

#: Frames shown in a second, of light on its way.
FRAMES_PER_S = 10
#: Frames of a scan are shown as fast as they were taken, if that is not slower or faster than these a second.
SLOWEST_PER_S, FASTEST_PER_S = 2, 25
_DPI = 80
_WIDTH_IN = 8.0
#: Colours of a GIF, 256 in all: those of the scale, and greys for letters.
_SCALE_COLOURS = 208


def save_video(volume: Volume, path: Path, compensation: str = "") -> None:
    """Write a video, GIF or MP4 by its ending; it appears whole or not at all.

    All frames have one scale: the amplitude by the maximum of the whole video; `compensation` says what the
    intensity was multiplied with against its fall-off, for the label.

    Raises
    ------
    UsageError
        As of `rig.show.endings.check_video`.
    DataFileError
        If the file cannot be written.
    """
    check_video(path)
    frames = _frames(volume, compensation)
    with refusals_told(path, "the video "), appearing(path) as partial:
        if path.suffix.lower() == ".gif":
            _write_gif(partial, frames, _per_s(volume), film_colours(volume))
        else:
            _write_mp4(partial, frames, _per_s(volume))


def _per_s(volume: Volume) -> int:
    """Return how many frames are shown in a second."""
    assert volume.t_s is not None
    if not volume.parameters.get("each_frame") or len(volume.t_s) < 2:
        return FRAMES_PER_S
    return int(np.clip(round(1 / float(np.diff(volume.t_s).min())), SLOWEST_PER_S, FASTEST_PER_S))


def _frames(volume: Volume, compensation: str) -> Iterator[NDArray[np.uint8]]:
    """Draw frame by frame: (height, width, 3), sides even, as MP4 wants them."""
    assert volume.t_s is not None
    amplitude = video_amplitude(volume)
    sides = [float(np.ptp(axis)) + 0.02 for axis in (volume.y_m, volume.x_m)]
    # inches around the picture, for labels, title and the bar
    left, right, bottom, top = 0.8, 1.4, 0.65, 0.85
    wide = _WIDTH_IN - left - right
    pixels = round((bottom + top + wide * min(1.5, sides[0] / sides[1])) * _DPI / 2) * 2
    tall = pixels / _DPI
    figure = Figure(figsize=(_WIDTH_IN, tall), dpi=_DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    high = (tall - bottom - top) / tall
    axes = figure.add_axes((left / _WIDTH_IN, bottom / tall, wide / _WIDTH_IN, high))
    drawn = draw_front(axes, amplitude[0], volume.x_m, volume.y_m, film_colours(volume), Normalize(0.0, 1.0))
    outline(axes, volume)
    bar = figure.add_axes(((left + wide + 0.2) / _WIDTH_IN, bottom / tall, 0.16 / _WIDTH_IN, high))
    figure.colorbar(drawn, cax=bar, label=video_label(compensation))
    figure.text(0.5, 1 - 0.25 / tall, f"{volume.scan}: {parameters_line(volume)}", ha="center")
    after = "" if volume.parameters.get("each_frame") else " after the flash"
    for image, time_s in zip(amplitude, volume.t_s, strict=True):
        drawn.set_data(image)  # type: ignore[attr-defined]
        axes.set_title(stamp(time_s, volume) + after, family="monospace")
        canvas.draw()
        yield np.array(canvas.buffer_rgba())[..., :3]


def _write_gif(path: Path, frames: Iterator[NDArray[np.uint8]], per_s: int, colours: str | Colormap) -> None:
    # Pillow's save() keeps all frames until the last; these two functions of it write one at a time.
    palette = _palette(colours)
    with path.open("xb") as file:
        for number, pixels in enumerate(frames):
            frame = Image.fromarray(pixels).quantize(palette=palette, dither=Image.Dither.NONE)
            if number == 0:
                header, _ = GifImagePlugin.getheader(frame.copy(), info={"loop": 0})
                file.writelines(header)
            file.writelines(GifImagePlugin.getdata(frame, duration=1000 // per_s))
        file.write(b";")  # the trailer


def _palette(colours: str | Colormap) -> Image.Image:
    """Return a picture with the palette of all frames."""
    scale = matplotlib.colormaps.get_cmap(colours)(np.linspace(0, 1, _SCALE_COLOURS))[:, :3]
    greys = np.repeat(np.linspace(0, 1, 256 - _SCALE_COLOURS)[:, None], 3, axis=1)
    image = Image.new("P", (1, 1))
    image.putpalette((np.concatenate([scale, greys]) * 255).round().astype(np.uint8).tobytes())
    return image


def _write_mp4(path: Path, frames: Iterator[NDArray[np.uint8]], per_s: int) -> None:
    first = next(frames)
    size = f"{first.shape[1]}x{first.shape[0]}"
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", str(per_s), "-i", "-"]
    command = ["ffmpeg", "-loglevel", "error", "-y", *raw, "-pix_fmt", "yuv420p", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            encoder.stdin.write(first.tobytes())
            for pixels in frames:
                encoder.stdin.write(pixels.tobytes())
            encoder.stdin.close()
        except BrokenPipeError:
            pass  # it says why on its way out
        said = encoder.stderr.read().decode(errors="replace").strip()
    if encoder.returncode:
        raise OSError(f"ffmpeg ended with {encoder.returncode}: {said}")
