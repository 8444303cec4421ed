"""Names that the simulated bench knows."""


def scene_names() -> tuple[str, ...]:
    """Return the names of the built-in scenes."""
    from simulators.scenes import SCENES

    return tuple(SCENES)
