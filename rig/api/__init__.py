"""The calls that Python programs use; `import rig` offers them, see ``docs/python.md``."""
