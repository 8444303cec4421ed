"""Heads of PicoQuant's older files: one layout for each instrument, read into the tags of a unified file."""

from rig.files.older.heads import is_older, read_older_head

__all__ = ["is_older", "read_older_head"]
