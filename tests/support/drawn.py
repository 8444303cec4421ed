"""What a picture shows, as numbers."""

import numpy as np


def panel(figure, label):
    """Return the only axes with this label at one of its sides."""
    (found,) = (axes for axes in figure.axes if label in (axes.get_xlabel(), axes.get_ylabel()))
    return found


def line(axes, label):
    """(N, 2) points of the line with a label that begins so."""
    (found,) = (one for one in axes.lines if str(one.get_label()).startswith(label))
    return np.asarray(found.get_xydata())


def coloured(axes):
    """(N, 2) places and (N,) values of the only coloured points."""
    (found,) = (one for one in axes.collections if one.get_array() is not None and len(one.get_offsets()))
    return np.asarray(found.get_offsets()), np.asarray(found.get_array())


def leftwards(axes):
    """Return whether x grows to the left."""
    left, right = axes.get_xlim()
    return left > right
