"""The page in a browser, of one scan that is stopped from it, and of the file that this leaves."""

import re
import subprocess
import sys
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from rig.acquire.log import log_of
from rig.files import ScanFile
from rig.live.watching import Watching
from rig.live.web.address import address
from support import browser

playwright = pytest.importorskip("playwright.sync_api")
pytestmark = pytest.mark.skipif(browser.FOUND is None, reason=browser.MISSING)
#: Four minutes, of which the test waits for a few positions: it is to be stopped, also by a slow browser.
SCAN = ("--grid", "16x12", "--spacing", "10cm", "--exposure", "1.2s")
REAL_TIME = "[simulation]\nreal_time = true\n"
NASTY = "<img src=x onerror=alert(1)>"


@pytest.fixture
def opened():
    """Open a page of a browser without a window."""
    with browser.opening() as opened:
        yield opened


@contextmanager
def scanning(command):
    """A scan, which ends at the latest with what is done with it."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as scan:
        try:
            yield scan
        except BaseException:
            scan.terminate()
            raise


def require_usable(page):
    """No finding of axe that is serious, nothing wider than the screen."""
    from axe_core_python.sync_playwright import Axe

    found = Axe().run(page)["violations"]
    bad = [(one["id"], one["nodes"][0]["html"]) for one in found if one["impact"] in ("serious", "critical")]
    assert not bad
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def waits_for(page, element, words):
    becomes_true(
        page,
        "([id, words]) => document.getElementById(id).checkVisibility() && "
        "document.getElementById(id).textContent.includes(words)",
        [element, words],
        f"{words!r} is not in #{element}",
    )


def becomes_true(page, script, about, otherwise):
    try:
        # a browser without a window may draw no frames, with which it would look else
        page.wait_for_function(script, arg=about, polling=100)
    except playwright.TimeoutError:
        pytest.fail(f"{otherwise} of the page, which says: {page.inner_text('body')}")


def test_a_scan_is_seen_by_many_stopped_from_the_page_and_watched_in_its_file(tmp_path, opened):
    path, rig = tmp_path / "a.h5", tmp_path / "rig.toml"
    rig.write_text(REAL_TIME)
    command = [sys.executable, "-m", "rig", "scan", "--config", str(rig), *SCAN, "--web", "--sample", NASTY]
    with scanning([*command, "--out", str(path)]) as scan:
        url = next(found[1] for line in scan.stderr if (found := re.search(r"Live page: (\S+)", line)))
        page = opened(url)
        waits_for(page, "light-words", "LASER ON since")
        waits_for(page, "phase", "exposing")
        grown = "(id) => parseInt(document.getElementById(id).ariaValueNow) > 0"
        becomes_true(page, grown, "bar", "no position is in #bar")
        with ThreadPoolExecutor(10) as viewers:
            states = list(viewers.map(lambda _: urllib.request.urlopen(f"{url}state").read(), range(10)))
        assert all(b"LASER ON" in state for state in states)
        require_usable(page)
        page.reload()
        waits_for(page, "light-words", "LASER ON since")
        assert NASTY in page.inner_text("#facts")
        assert page.locator("#facts img").count() == 0
        stop_from_the_keyboard(page)
        waits_for(page, "end-words", "Interrupted after")
        waits_for(page, "light-words", "laser dark, read back")
        assert page.inner_text("#end-command") == f"rig resume {path}"
        assert not page.locator("#stop").is_visible()
        told = scan.stderr.read()
        waits_for(page, "lost", "has not been served since")
        waits_for(page, "light-words", "not known now")
    assert scan.returncode == 6
    assert "Stopping after this position." in told
    with ScanFile(path) as file:
        assert 0 < file.done.sum() < file.steps
        assert "page in a browser, at 127.0.0.1" in file.reason
    assert "page in a browser, at 127.0.0.1" in log_of(path).read_text()
    watch(path, opened)


def stop_from_the_keyboard(page):
    """Ask for the stop, think better of it, and ask again; by keys alone."""
    page.focus("#stop")
    page.keyboard.press("Enter")
    assert page.locator("#sure").is_visible()
    require_usable(page)
    page.keyboard.press("Escape")
    assert not page.locator("#sure").is_visible()
    page.keyboard.press("Enter")
    page.focus("#sure-yes")
    page.keyboard.press("Enter")
    waits_for(page, "stop-said", "after this position")


def watch(path, opened):
    """The same page on a phone, of the file alone; and when its server is gone."""
    before, troubles = path.read_bytes(), []
    with Watching(path, address("127.0.0.1"), troubles.append) as watching:
        page = opened(watching.address.url, 360, 740)
        waits_for(page, "end-words", "Interrupted after")
        waits_for(page, "front-title", "Last image")
        assert "log" in page.inner_text("#light-from")
        assert not page.locator("#stop").is_visible()
        refused = page.evaluate("fetch('stop', {method: 'POST'}).then((answer) => answer.status)")
        assert refused == 403
        require_usable(page)
        watching.stop()
    waits_for(page, "lost", "has not been served since")
    assert (troubles, path.read_bytes()) == ([], before)
    assert {one.name for one in path.parent.iterdir()} == {"a.h5", "a.log", "a-live", "rig.toml"}
