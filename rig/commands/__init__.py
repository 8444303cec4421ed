"""The verbs of the command ``rig``. They import heavy libraries when they run: ``--help`` stays quick."""

from rig.commands.app import app, command

__all__ = ["app", "command"]
