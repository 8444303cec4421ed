"""The Optotune MR-15-30 steering mirror on its MR-E-2 or MR-E-3 board."""

from drivers.optotune.limits import OptotuneLimits
from drivers.optotune.mirror import OptotuneMirror
from drivers.optotune.status import MirrorStatus

__all__ = ["MirrorStatus", "OptotuneLimits", "OptotuneMirror"]
