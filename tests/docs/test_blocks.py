"""Every command and every block of code on the pages is one that works.

Each command is read by the real command line. Those of the README and the tutorial are run, in their order,
each page in one folder; so is each block of Python. A block that cannot run here has the comment
``<!-- not run: REASON -->`` above it, and `NOT_RUN` counts these.
"""

import re
import shutil
from collections import Counter

import pytest
import typer

from rig.commands import app
from rig.model.asked import columns_and_rows
from rig.model.config import load
from rig.model.quantities import parse
from support.pages import ROOT, Block, blocks, commands, pages

SHELL = blocks("sh")
TABLES = [block for block in blocks("toml") if not block.reason]
RUN_WHOLE = ("README.md", "docs/tutorial/")
#: How many blocks are not run, and why; one that is added has to be counted here.
NOT_RUN = {
    "it changes the shell": 1,
    "it describes a package": 1,
    "it installs": 1,
    "it needs a real rig": 1,
    "it needs files from elsewhere": 1,
    "it needs minutes, or files from elsewhere": 1,
    "it needs the package described above": 1,
    "it runs these tests": 1,
}


def from_to_step(text: str) -> None:
    """Read three depths, or three moments of a video."""
    first, *others = text.split(":")
    kind = "time" if first.endswith("s") else "length"
    assert [parse(part, kind) for part in (first, *others)][2:], text


#: What an option's metavar promises of its value.
READERS = {
    "TIME": lambda text: parse(text, "time"),
    "LENGTH": lambda text: parse(text, "length"),
    "DEPTH": lambda text: parse(text, "length"),
    "FREQUENCY": lambda text: parse(text, "frequency"),
    "BYTES": lambda text: parse(text, "memory"),
    "COLSxROWS": columns_and_rows,
    "FROM:TO:STEP": from_to_step,
}


def ids(found: list[Block]) -> list[str]:
    return [str(block) for block in found]


def read(words: list[str]) -> list[tuple[str | None, object]]:
    """Read a command as ``rig`` does, without running it; return what its parameters take, and the values."""
    if {"--install-completion", "--show-completion"} & {*words}:  # which end as soon as they are read
        return []
    name, command = "rig", typer.main.get_command(app)
    while isinstance(command, typer.core.TyperGroup):
        name, *words = words
        command = command.commands[name]
    context = command.make_context(name, words)
    return [(one.metavar, context.params[one.name]) for one in command.params if one.name in context.params]


@pytest.mark.parametrize("block", SHELL, ids=ids(SHELL))
def test_the_command_line_takes_every_command(block):
    for program, *words in commands(block):
        if program != "rig":
            continue
        for takes, value in read(words):
            if isinstance(value, str) and takes in READERS:
                READERS[takes](value)


def test_no_command_stands_where_it_is_not_tried():
    """In an indented block, that is, which has no language."""
    for page in pages():
        assert not re.findall(r"^ {4}rig .*", page.read_text(encoding="utf-8"), re.MULTILINE), page.name


def test_blocks_that_are_not_run_are_counted():
    found = Counter(block.reason for block in blocks("sh", "python", "toml") if block.reason)
    assert dict(found) == NOT_RUN


#: Where a page does not say how many positions, these are enough to see that a command works.
FEW = ("--grid", "18x13", "--spacing", "9cm")


def run(block: Block, rig) -> None:
    """Run the commands of a block that are this program's; its scans have few positions."""
    for program, *words in commands(block):
        if program == "rig":
            few = FEW if coarser(words) else ()
            done = rig(*words, *few)
            assert done.code == 0, f"{block}: rig {' '.join(words)}: {done.err}"


def coarser(words: list[str]) -> bool:
    measures = words[0] == "scan" or words[:2] == ["sim", "render"]
    return measures and "--grid" not in words and "--preset" not in words


def of_page(start: str) -> list[Block]:
    return [block for block in SHELL if block.page.startswith(start) and not block.reason]


@pytest.mark.parametrize("page", RUN_WHOLE)
def test_commands_of_a_page_work_in_their_order(page, rig, tmp_path):
    (tmp_path / "docs").symlink_to(ROOT / "docs")  # pages are read in the project's folder
    found = of_page(page)
    assert found
    for block in found:
        run(block, rig)


def test_blocks_of_python_run(rig):
    """In a folder with a scan, its volume and its surface, as the pages name them."""
    for words in ("scan --out scan.h5", "recon scan.h5 --voxel 5cm", "export scan-volume.h5 letters.ply"):
        done = rig(*words.split(), *(FEW if words.startswith("scan") else ()))
        assert done.code == 0, done.err
    # docs/python.md is one walk, which tests/api goes
    found = [block for block in blocks("python") if not block.reason and block.page != "docs/python.md"]
    assert found
    for block in found:
        exec(compile(block.text, str(block), "exec"), {"__name__": "block"})  # its place is in the traceback


@pytest.mark.parametrize("block", TABLES, ids=ids(TABLES))
def test_tables_are_configurations(block, tmp_path):
    shutil.copy(ROOT / "configs/lab.toml", tmp_path)  # which some of them extend
    (tmp_path / "block.toml").write_text(block.text, encoding="utf-8")
    assert load(tmp_path / "block.toml", {"simulation": {}}).simulated
