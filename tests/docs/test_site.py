"""The pages make a site without a warning, and no link on them leads nowhere."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from rig.commands.documents import DOCUMENTS
from rig.model.config.kinds import ROLES
from support.pages import ROOT, pages


class Read(HTMLParser):
    """The links of a page, and the places on it that links can lead to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in ("href", "src") and value]
        self.places |= {value for name, value in attrs if name in ("id", "name") and value}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Build the site, as CONTRIBUTING says."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "docs", folder],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_every_link_of_the_site_leads_somewhere(site):
    read = {page: Read(page.read_text(encoding="utf-8")) for page in site.rglob("*.html")}
    assert len(read) > len(pages())
    astray = [
        f"{page.relative_to(site)}: {link}"
        for page, found in read.items()
        for link in found.links
        if not leads_somewhere(page, link, read)
    ]
    assert not astray


def leads_somewhere(page: Path, link: str, read: dict[Path, Read]) -> bool:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return True
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    if target.suffix == ".html" and parts.fragment:
        return target in read and unquote(parts.fragment) in read[target].places
    return target.exists()


def test_every_relative_link_of_a_page_is_a_file():
    """So that they also hold where the pages are read as they are."""
    made = ("docs/reference/",)
    for page in [
        *pages(),
        ROOT / "CHANGELOG.md",
        ROOT / "CONTRIBUTING.md",
        *ROOT.glob("docs/decisions/*.md"),
    ]:
        for link in re.findall(r"\]\(([^)#:\s]+)(?:#[^)\s]*)?\)", page.read_text(encoding="utf-8")):
            target = (page.parent / link).resolve()
            assert target.exists() or str(target.relative_to(ROOT)).startswith(made), f"{page.name}: {link}"


def test_the_pages_from_the_code_leave_nothing_out(site):
    """Each verb is there, each kind of device, and each key of the configuration says what it is."""
    made = ROOT / "docs/reference"
    commands = (made / "commands.md").read_text(encoding="utf-8")
    assert {f"## rig {verb}" for verb in DOCUMENTS} <= set(commands.splitlines())
    configuration = (made / "configuration.md").read_text(encoding="utf-8")
    for role, one in ROLES.items():
        assert all(f'{role}.kind = "{kind}"' in configuration for kind in one.kinds)
    keys = [line for line in configuration.splitlines() if line.startswith("| `")]
    assert len(keys) > 200
    assert not [key for key in keys if key.endswith("|  |")]
