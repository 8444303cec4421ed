"""Makes the pictures of docs/calibration/galvo.md: both methods on the misaligned rig of the tests.

Run from the project's root: python docs/figures/calibration_galvo.py
"""

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from rig.acquire.acquisition import Watch  # noqa: E402
from rig.calibrate.galvo.flight import FlightRoutine  # noqa: E402
from rig.calibrate.galvo.routine import CameraRoutine  # noqa: E402
from rig.calibrate.run import measured  # noqa: E402
from rig.commands.operator import ConsoleOperator  # noqa: E402
from rig.model.state import RigState  # noqa: E402
from rig.show.volume import save  # noqa: E402
from support.misaligned import misaligned  # noqa: E402

for name, routine in (("flight", FlightRoutine()), ("cameras", CameraRoutine())):
    config = misaligned()
    with tempfile.TemporaryDirectory() as folder:
        files = measured(routine, config, ConsoleOperator(), Path(folder), Watch())
        found = routine.fit(files, RigState(config))
        save(routine.figure(files, found), ROOT / "docs" / "images" / f"calibration_galvo_{name}.png")
