"""Pictures of the live view, from scans: what it showed at some parts of their time.

    python docs/figures/live.py SCAN.h5 PART PICTURE.png [PART PICTURE.png]...

Photons go through the same state, image and figure as in ``rig scan --live``; the hours are made up.
"""

import sys
from dataclasses import replace
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from small import shrink

from rig.acquire.engine import Ended, LightChanged, Outcome, Phase, PhaseChanged
from rig.files import ScanFile
from rig.live.figure import LiveFigure
from rig.live.follow import described
from rig.live.process import STEPS_AT_ONCE, Growing, block_of
from rig.live.state import LiveState, Subject
from rig.show.saving import save

BEGAN_S = 1_800_000_000.0  # seconds since 1970
OVERHEAD = 1.3  # time of a step in exposures


def draw(scan, stages):
    """Draw the view at parts of the scan, {part: picture}."""
    state = LiveState(Subject.of(scan.path.name, described(scan)))
    imaging, figure = Growing(state.subject), Figure()
    FigureCanvasAgg(figure)
    view, left = LiveFigure(figure, state.subject), sorted(stages)
    state(PhaseChanged(Phase.EXPOSING))
    state(LightChanged(True, "2027-01-15T08:00:00+00:00"))
    for first in range(0, scan.steps, STEPS_AT_ONCE):
        if not left:
            break  # so that a scan need not be complete
        stop = min(first + STEPS_AT_ONCE, scan.steps)
        when_s = BEGAN_S + stop * OVERHEAD * state.subject.exposure_s
        block = replace(block_of(scan, range(first, stop)), when_s=when_s)
        state(block)
        imaging.add(block)
        if left and stop >= left[0] * scan.steps:
            end = stop == scan.steps
            if end:
                state(LightChanged(False, f"2027-01-15T08:{int(when_s - BEGAN_S) // 60:02d}:59+00:00"))
                state(Ended(Outcome.COMPLETE, stop, "all positions measured"))
            picture = imaging.last(stop) if end else imaging.picture()
            state.show(picture, imaging.title, final=end)
            view.update(state.seen())
            drawn = stages[left.pop(0)]
            save(figure, drawn)
            shrink(drawn)


if __name__ == "__main__":
    with ScanFile(sys.argv[1]) as opened:
        draw(
            opened,
            {float(part): Path(name) for part, name in zip(sys.argv[2::2], sys.argv[3::2], strict=True)},
        )
