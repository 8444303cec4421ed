"""``rig report``: one page that tells of a scan, whatever is in its file, and reaches nothing outside."""

import json
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.files import ScanDescription, ScanFile, ScanWriter, Volume, write_volume
from rig.model.config import built_in_with, load
from rig.model.plan import Pass, ScanPlan, Spots
from rig.model.state import RigState
from rig.show.page import element, page

NASTY = '<script>alert(1)</script> & "quoted" \x1b[31m'
CONFIG = built_in_with(
    {
        "scan": {"columns": 6, "rows": 4, "spacing": "10cm", "skip": "0cm"},
        "notes": {"operator": "Ada", "note": NASTY},
    }
)


class Read(HTMLParser):
    """What a browser would see: text, and where it would look."""

    VOID = ("meta", "img")

    def __init__(self, text):
        super().__init__()
        self.names, self.addresses, self.open, self.words = [], [], [], []
        self.feed(text)
        assert not self.open, "all elements are closed"

    def handle_starttag(self, tag, attrs):
        self.names.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] != ["style"]:
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def write_scan(path, steps=24, plan=None, closed=True):
    plan = plan or ScanPlan.grid(CONFIG)
    description = ScanDescription(
        plan.spots_m, np.zeros((1, 3)), 2000, 16e-12, 0.0, plan=plan, state=RigState(CONFIG), simulated=True,
        command="rig scan --out 'a b.h5'", devices={"laser": {"identity": "Laser <1>", "repetition_hz": 1e7}},
    )  # fmt: skip
    writer = ScanWriter.create(path, description)
    for step in range(steps):
        writer.append(np.bincount([400] * (step + 1), minlength=2000).astype("u4"), 0.01)
    writer.note(f"a bin is full {NASTY}", 3, 5)
    writer.checkpoint()
    if closed:
        writer.close("complete" if steps == len(plan) else "interrupted", "as the test wants it")
    return writer


def write_image(path, scan):
    axes = np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 4), np.linspace(0.5, 1, 3)
    with ScanFile(scan) as found:
        digest = found.digest
    parameters = {"camera": "confocal", "solver": "rsd", "wavelength_m": 0.04, "cycles": 2.0}
    intensity = np.random.default_rng(1).random((3, 4, 5), "f4")
    write_volume(
        path,
        Volume(
            intensity, *axes, parameters=parameters, scan="a.h5", scan_digest=digest, command="rig recon a.h5"
        ),
    )


def test_the_page_tells_all_and_reaches_nothing_outside(rig):
    write_scan(Path("a.h5"))
    write_image("a-volume.h5", "a.h5")
    done = rig("report", "a.h5")
    assert done.code == 0, done.err
    text = Path("a-report.html").read_text(encoding="utf-8")
    seen = Read(text)
    assert "script" not in seen.names
    assert seen.addresses
    assert all(address.startswith("data:image/png;base64,") for address in seen.addresses)
    assert seen.names.count("img") == 4  # the image, counts over the wall, rates, histograms
    assert "default-src 'none'" in text.replace("&#x27;", "'")
    with ScanFile("a.h5") as scan:
        digest = scan.digest
    for words in (
        "Ada", r'<script>alert(1)</script> & "quoted" \x1b[31m', "Laser <1>", "10 MHz", "wavelength 4 cm",
        "6 x 4, 10 cm apart", "rig scan --out 'a b.h5'", "rig recon a.h5", "rig report a.h5 a-volume.h5",
        digest, "3 to 5", "complete", "300", "From 1 to 24 at a spot",
    ):  # fmt: skip
        assert words in seen.text, words


def test_the_configuration_on_the_page_is_one_that_is_read_back(rig):
    write_scan(Path("a.h5"))
    assert rig("report", "a.h5").code == 0
    words = Read(Path("a-report.html").read_text(encoding="utf-8")).words
    (toml,) = [word for word in words if "[simulation]" in word]
    Path("again.toml").write_text(toml)
    assert load(Path("again.toml")).differences(CONFIG) == []
    assert load(Path("again.toml")).scan == CONFIG.scan


def test_a_video_of_all_depths_is_shown(rig):
    write_scan(Path("a.h5"))
    axes = np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 4), np.linspace(0.5, 1, 3)
    intensity = np.random.default_rng(1).random((7, 3, 4, 5), "f4")
    said = {"parameters": {"camera": "transient", "solver": "rsd"}, "scan": "a.h5"}
    write_volume("a-volume.h5", Volume(intensity, *axes, t_s=np.linspace(1e-9, 4e-9, 7), **said))
    done = rig("report", "a.h5")
    assert done.code == 0, done.err
    seen = Read(Path("a-report.html").read_text(encoding="utf-8"))
    assert seen.names.count("img") == 4
    assert "7, 1 ns to 4 ns" in seen.text


def test_an_image_of_another_scan_is_named_as_that(rig):
    write_scan(Path("a.h5"))
    write_image("v.h5", "a.h5")
    with h5py.File("a.h5", "r+") as file:
        file.attrs["software"] = "another"
    done = rig("report", "a.h5", "v.h5", "--out", "page.html", "--json")
    assert done.code == 0, done.err
    (doubt,) = json.loads(done.out)["doubts"]
    assert "v.h5 was not made from the present a.h5, but" in doubt
    assert doubt in Read(Path("page.html").read_text(encoding="utf-8")).text


def test_a_page_in_three_dimensions_is_linked_where_there_is_one(rig):
    write_scan(Path("a.h5"))
    write_image("a-volume.h5", "a.h5")
    Path("a-volume.html").write_text("turn me")
    assert rig("report", "a.h5").code == 0
    assert "a-volume.html" in Read(Path("a-report.html").read_text(encoding="utf-8")).addresses


@pytest.mark.parametrize("what", ["nothing measured", "still growing", "passes that are no picture"])
def test_a_scan_that_cannot_be_imaged_has_a_page_too(rig, what):
    plan = None
    if what == "passes that are no picture":
        spots = Spots(spots=((0.1, 0.0, 0.0), (0.2, 0.0, 0.0)))
        passes = [Pass(name=name, positions=spots, exposure_s=0.01, hold_off_s=off_s)
                  for name, off_s in (("short", 1e-7), ("long", 2e-7))]  # fmt: skip
        plan = ScanPlan(passes=tuple(passes))
    steps = {"nothing measured": 0, "still growing": 12}.get(what, 4)
    writer = write_scan(Path("a.h5"), steps, plan, closed=what != "still growing")
    done = rig("report", "a.h5")
    assert done.code == 0, done.err
    told = Read(Path("a-report.html").read_text(encoding="utf-8")).text
    expected = {
        "nothing measured": "No position was measured",
        "still growing": "still being written",
        "passes that are no picture": "No histograms are drawn",
    }
    assert expected[what] in told
    writer.close("interrupted")


def test_a_damaged_scan_leaves_no_page(rig):
    write_scan(Path("a.h5"))
    Path("a.h5").write_bytes(Path("a.h5").read_bytes()[:3000])
    assert rig("report", "a.h5").code == 5
    assert not list(Path().glob("*.html"))


def test_text_is_escaped_wherever_it_comes_from():
    built = page("<t>", [element("p", NASTY, class_='"><b>'), NASTY])
    seen = Read(built)
    assert set(seen.names) == {"html", "head", "meta", "title", "style", "body", "p"}
    assert seen.text.count("<script>") == 2
