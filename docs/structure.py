"""Count how the house is built: rooms, arrows, circles, lines, long lists of parameters.

    python docs/structure.py [FOLDER]

A room is what lies directly in a package: a file or a folder. An arrow is that one room imports another, a
circle a set of files that import each other. FOLDER is another checkout to count.
"""

import ast
import sys
from pathlib import Path

PACKAGES = ("rig", "recon", "drivers", "simulators")
#: A function with more parameters than this is counted.
PARAMETERS = 8


def modules(root: Path) -> dict[str, Path]:
    """Return the path of each module by its dotted name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """Return the modules of the house that a module imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in known else node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {one for one in found if one in known and one != name}


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that import each other (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(arrows.get(node, ())):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            cut = stack.index(node)
            component = stack[cut:]
            del stack[cut:]
            if len(component) > 1:
                found.append(sorted(component))

    sys.setrecursionlimit(10_000)
    for node in sorted(arrows):
        if node not in index:
            visit(node)
    return found


def wide_functions(path: Path) -> int:
    """Return how many functions of a file take more than `PARAMETERS` parameters, without self and cls."""
    wide = 0
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            wide += sum(one.arg not in {"self", "cls"} for one in named) > PARAMETERS
    return wide


def main() -> None:
    """Print a row for each package, and for each room of rig."""
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    known = modules(root)
    arrows = {name: imports(name, path, known) for name, path in known.items()}
    print(f"{'package':<18}{'rooms':>6}{'arrows':>8}{'circles':>9}{'files':>7}{'lines':>8}{'wide':>6}")
    for package in PACKAGES:
        mine = {name: path for name, path in known.items() if name.split(".")[0] == package}
        room = {name: ".".join(name.split(".")[:2]) for name in mine}
        pairs = {(room[a], room[b]) for a in mine for b in arrows[a] if b in mine and room[a] != room[b]}
        pairs = {(a, b) for a, b in pairs if package not in {a, b}}
        tied = circles({a: {b for b in arrows[a] if b in mine} for a in mine})
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in mine.values())
        wide = sum(map(wide_functions, mine.values()))
        rooms = len(set(room.values()) - {package})
        print(f"{package:<18}{rooms:>6}{len(pairs):>8}{len(tied):>9}{len(mine):>7}{lines:>8}{wide:>6}")
        for circle in tied:
            print("  circle:", ", ".join(circle))
    for name in sorted({".".join(one.split(".")[:2]) for one in known if one.startswith("rig.")}):
        mine = [path for one, path in known.items() if one == name or one.startswith(name + ".")]
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in mine)
        print(f"  {name:<39}{len(mine):>7}{lines:>8}")


if __name__ == "__main__":
    main()
