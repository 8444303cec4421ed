"""Values that the shell completes: names that a person would otherwise look up. Nothing heavy is imported."""


def scenes(incomplete: str) -> list[str]:
    """Return the built-in scenes that begin so."""
    from rig.bench.names import scene_names

    return [name for name in scene_names() if name.startswith(incomplete)]


def truths(incomplete: str) -> list[str]:
    """Return the built-in scenes as a truth is named."""
    if not "scene:".startswith(incomplete[:6]):
        return []
    return [f"scene:{name}" for name in scenes(incomplete[6:])]


def presets(incomplete: str) -> list[tuple[str, str]]:
    """Return the presets that begin so, each with what it is."""
    from rig.model.presets import about

    known = {"list": "names all presets", **about()}
    return [(name, what) for name, what in known.items() if name.startswith(incomplete)]
