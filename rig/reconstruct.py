"""From a scan file to an image: choose what was not given, focus, find the depths, write the volume."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from recon.capture import Capture
from recon.grid import VoxelGrid
from recon.imaging import Image, Solver, image
from recon.preparation import Fades
from recon.wave import VirtualPulse
