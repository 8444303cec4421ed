"""Hidden scenes, built in or from a mesh file: shapes and materials only, no light."""

from collections.abc import Callable
from pathlib import Path

from simulators.scenes import lettered, shelves, targets
from simulators.scenes.files import ENDINGS, Placement, from_file
from simulators.scenes.lettered import letter
from simulators.scenes.mesh import Mesh, Scene
from simulators.scenes.office import office
from simulators.scenes.solids import quads_mesh

__all__ = ["SCENES", "Mesh", "Placement", "Scene", "from_file", "letter", "quads_mesh", "scene"]

#: The built-in scenes.
SCENES: dict[str, Callable[[], Scene]] = {
    "letters": lettered.letters,
    "letter-plane": lettered.letter_plane,
    "letters-rd": lettered.letters_rd,
    "large-depth": lettered.large_depth,
    "four": lettered.four,
    "office": office,
    "shelf": shelves.shelf,
    "bookshelf": shelves.bookshelf,
    "bookshelf-corridor": shelves.bookshelf_corridor,
    "patches": targets.patches,
    "resolution": targets.resolution,
    "point": targets.point,
    "empty": targets.empty,
}


def scene(name: str = "letters", placement: Placement | None = None) -> Scene:
    """Build a scene by name, or read it from a mesh file by its path, which is placed.

    Raises
    ------
    ValueError
        If there is no such scene, or its file cannot be used.
    """
    if Path(name).suffix.lower() in ENDINGS:
        return from_file(Path(name), placement=placement)
    if name not in SCENES:
        raise ValueError(
            f"no scene {name!r}; the built-in scenes are {', '.join(SCENES)}; or give the path of an OBJ, "
            "PLY or STL file"
        )
    return SCENES[name]()
