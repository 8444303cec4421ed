"""Compare the models of gloss: draw docs/images/gloss.png, print the tables of docs/scenes.md (15 s).

python docs/figures/gloss.py
"""

from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.show.saving import save
from simulators.scenes import scene
from simulators.transport.reflectance import gloss
from simulators.transport.renderer import Transport

PICTURE = Path(__file__).parents[1] / "images" / "gloss.png"
MODELS = {"ward": "--", "ggx": "-"}
ALPHAS = {0.1: "C0", 0.2: "C1", 0.4: "C2", 0.8: "C3"}
SCENES = ("letters-rd", "shelf", "office", "bookshelf-corridor")
#: Laser spots over the scanned wall, and bins of the time after it [s].
SPOTS_M = np.array([(x, y, 0.0) for x in np.linspace(-0.9, 0.9, 13) for y in np.linspace(-0.65, 0.65, 9)])
EDGES_S = np.arange(0, 30e-9, 16e-12)


def lobe(model: str, alpha: float, polar_deg: float, o: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lobe's reflectance (K,) [1/sr] from an angle of incidence to directions (K, 3)."""
    polar = np.radians(polar_deg)
    far = 1e8 * np.array([-np.sin(polar), 0.0, np.cos(polar)])  # seen in one direction by all patches
    weight, all_ = np.ones(len(o)), np.ones(len(o), bool)
    looks = alpha * weight, ~all_, all_ if model == "ggx" else ~all_
    gloss(weight, -o, np.tile([0.0, 0.0, 1.0], (len(o), 1)), *looks, far, np.zeros(3))
    return (weight - alpha) / (1 - alpha) / np.pi


def energy(model: str, alpha: float, polar_deg: float, parts: int = 1000) -> float:
    """Return the share of light that leaves by the lobe of a white surface, as a sum over the hemisphere."""
    middles = (np.arange(parts) + 0.5) / parts * 2 - 1
    x, y = (values.ravel() for values in np.meshgrid(middles, middles))
    up2 = 1 - x * x - y * y
    above = up2 > 0
    o = np.column_stack([x[above], y[above], np.sqrt(up2[above])])
    return float(lobe(model, alpha, polar_deg, o).sum()) * (2 / parts) ** 2  # cos(theta) dOmega is dx dy


def print_scenes() -> None:
    """Print how far the transients of scenes differ: Ward's energy over that of GGX, and their likeness."""
    for name, alpha in product(SCENES, ALPHAS):
        ward, ggx = (
            Transport.of_scene(scene(name).with_roughness(alpha).with_gloss(model)).transients(
                SPOTS_M, np.zeros((1, 3)), EDGES_S
            )
            for model in ("ward", "ggx")
        )
        each = (ward * ggx).sum(axis=1) / np.sqrt((ward**2).sum(axis=1) * (ggx**2).sum(axis=1))
        whole = (ward * ggx).sum() / np.sqrt((ward**2).sum() * (ggx**2).sum())
        print(
            f"{name}, {alpha}: energy {ward.sum() / ggx.sum():.3f},",
            f"likeness {whole:.4f}, least {each.min():.4f}",
        )


def main() -> None:
    """Draw the lobes and their energies, and print what the page shows."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    lobes, energies = figure.subplots(1, 2)
    leaves_deg, arrives_deg = np.linspace(-89, 89, 713), np.linspace(0, 85, 18)
    leaves = np.radians(leaves_deg)
    o = np.column_stack([np.sin(leaves), 0 * leaves, np.cos(leaves)])
    for alpha, model in product(ALPHAS, MODELS):
        look = {"color": ALPHAS[alpha], "linestyle": MODELS[model], "label": f"{model} {alpha}"}
        lobes.semilogy(leaves_deg, lobe(model, alpha, 30, o), **look)
        of_angle = [energy(model, alpha, polar_deg) for polar_deg in arrives_deg]
        energies.plot(arrives_deg, of_angle, **look)
        told = (f"{np.interp(at, arrives_deg, of_angle):.3f}" for at in (0, 45, 75))
        print(f"{model}, {alpha}: lobe's energy at 0, 45, 75 degrees", *told)
    lobes.set(xlabel="angle of exit (degrees), light from 30", ylabel="reflectance (1/sr)", ylim=(1e-3, 40))
    energies.set(xlabel="angle of incidence (degrees)", ylabel="share of light in the lobe", ylim=(0, 1.05))
    energies.legend(fontsize=7, ncols=2)
    save(figure, PICTURE)
    print_scenes()


if __name__ == "__main__":
    main()
