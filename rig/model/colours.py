"""Colours that mean the same in all pictures."""

import matplotlib
import numpy as np
from matplotlib.colors import ListedColormap

AMPLITUDE_COLOURS = "inferno"
#: Depth: near is dark, far is bright. Lightness rises all the way, for prints in grey and for the
#: colour-blind; the brightest end is left out, so that the far stands out from `NO_SURFACE`.
DEPTH_COLOURS = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, 0.88, 256)), name="depth")
_HEAT = matplotlib.colormaps["inferno_r"](np.linspace(0.1, 0.78, 224))
#: Light on its way: no light is white, so that a film is not black between two flashes of its own.
LIGHT_COLOURS = ListedColormap(
    np.vstack([np.linspace([1.0, 1.0, 1.0, 1.0], _HEAT[0], 32), _HEAT]), name="light"
)
NO_SURFACE = "0.94"  # nearly white: lighter than all colours of depth
