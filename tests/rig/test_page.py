"""The page of a volume shows it where it is, in a browser, without anything from elsewhere."""

import base64
import gzip
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.image import imread

from rig.errors import UsageError
from rig.exporters import export, page
from rig.files import Volume, read_volume, write_volume
from support import browser

in_a_browser = pytest.mark.skipif(browser.FOUND is None, reason=browser.MISSING)
BLOB_M = (0.5, 0.3, 1.0)
WALL_M = [-0.9, 0.9, -0.65, 0.65]


def blob(path, **changes):
    """Write a volume of 1.8 x 1.2 x 1.5 m with one blob of 6 cm."""
    x_m, y_m, z_m = np.linspace(-0.9, 0.9, 61), np.linspace(-0.6, 0.6, 41), np.linspace(0.5, 2.0, 51)
    z, y, x = np.meshgrid(z_m, y_m, x_m, indexing="ij")
    distance_m = np.sqrt(sum((axis - at) ** 2 for axis, at in zip((x, y, z), BLOB_M, strict=True)))
    intensity = (np.exp(-((distance_m / 0.06) ** 2)) / z**4).astype("f4")
    depth_m = np.where((intensity * z**4).max(axis=0) > 0.2, BLOB_M[2], np.nan).astype("f4")
    given = {
        "parameters": {"solver": "rsd", "wavelength_m": 0.04, "origin": {"wall_m": WALL_M, "photons": 12345}},
        "scan": "a.h5",
        "depth_m": depth_m,
    }
    write_volume(path, Volume(intensity, x_m, y_m, z_m, **(given | changes)))
    return read_volume(path)


def written(folder, **changes):
    """Write a volume and its page; return both."""
    volume = blob(folder / "v.h5", **changes)
    export(folder / "v.h5", folder / "v.html")
    return volume, folder / "v.html"


class Parts(HTMLParser):
    """Texts by the element's id, and every address that a browser would follow."""

    def __init__(self, text):
        super().__init__()
        self.texts, self.addresses, self._id = {}, [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        told = dict(attrs)
        self._id = told.get("id")
        self.addresses += [told[name] for name in ("src", "href", "action", "data") if name in told]

    def handle_data(self, data):
        self.texts[self._id] = self.texts.get(self._id, "") + data


def unpacked(text, dtype):
    return np.frombuffer(gzip.decompress(base64.b64decode(text)), dtype)


def test_the_page_holds_the_volume_and_needs_nothing_else(tmp_path):
    volume, path = written(tmp_path)
    text = path.read_text("utf-8")
    parts = Parts(text)
    facts = json.loads(parts.texts["facts"])
    assert [facts[axis]["count"] for axis in "xyz"] == [61, 41, 51]
    for axis in "xyz":
        at_m = facts[axis]["first_m"] + facts[axis]["pitch_m"] * np.arange(facts[axis]["count"])
        np.testing.assert_allclose(at_m, getattr(volume, f"{axis}_m"), atol=1e-9)
    amplitude = np.sqrt(volume.intensity) * volume.z_m[:, None, None] ** 2
    voxels = unpacked(parts.texts["voxels"], np.uint8).reshape(51, 41, 61) / 255
    assert np.abs(voxels - amplitude / amplitude.max()).max() < 0.5 / 255 + 1e-6  # half a step
    near, far = facts["depths_m"]
    levels = unpacked(parts.texts["surface"], "<u2").reshape(41, 61).astype(float)
    depth_m = np.where(levels > 0, near + (levels - 1) / 65534 * (far - near), np.nan)
    np.testing.assert_allclose(depth_m, volume.depth_m, atol=(far - near) / 65534)
    assert facts["wall_m"] == WALL_M
    assert facts["wall_known"]
    assert all(address.startswith("data:") for address in parts.addresses)
    assert "default-src 'none'" in text
    assert not re.search(r"https?:|//\w+\.|@import|\bfetch\(|XMLHttpRequest|WebSocket", text)
    assert "12,345 photons" in text


def test_the_same_volume_gives_the_same_page(tmp_path):
    _, path = written(tmp_path)
    export(tmp_path / "v.h5", tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == path.read_bytes()


def test_names_are_text_and_nothing_else(tmp_path):
    name = "</script><script>alert(1)</script>@VOXELS@&.h5"
    _, path = written(tmp_path, scan=name, parameters={"solver": name, "estimated": [name], "camera": name})
    text = path.read_text("utf-8")
    assert "<script>alert" not in text
    assert text.count("</script>") == 6
    assert text.count("@VOXELS@") == 5  # title and heading; camera, solver and estimate, as they were given


def test_many_voxels_are_put_together_by_their_maximum(tmp_path):
    values = np.random.default_rng(1).random((7, 10, 5), "f4")
    smaller, factor = page.pooled(values, most=100)
    assert factor == (2, 2, 1)
    assert smaller.shape == (4, 5, 5)
    for k, j, i in np.ndindex(smaller.shape):
        assert smaller[k, j, i] == values[2 * k : 2 * k + 2, 2 * j : 2 * j + 2, i].max()


def test_a_film_has_no_page(tmp_path):
    film = np.ones((2, 4, 5), "f4")
    write_volume(
        tmp_path / "v.h5", Volume(film, np.arange(5.0), np.arange(4.0), np.ones(1), t_s=np.arange(2.0))
    )
    with pytest.raises(UsageError, match="a film"):
        export(tmp_path / "v.h5", tmp_path / "v.html")
    assert not (tmp_path / "v.html").exists()


@pytest.mark.parametrize(
    "changes", [{"depth_m": None}, {"depth_m": np.full((41, 61), np.nan, "f4")}, {"parameters": {}}]
)
def test_what_a_volume_lacks_is_left_out(tmp_path, changes):
    _, path = written(tmp_path, **changes)
    facts = json.loads(Parts(path.read_text("utf-8")).texts["facts"])
    assert facts["depths_m"][1] > facts["depths_m"][0]
    assert facts["shown_m"][1] > facts["shown_m"][0]


@pytest.fixture(scope="module")
def opened():
    """Open a page of a browser without a window, wait until all that it can show is shown, and return it."""
    with browser.opening() as opened:

        def shown(path, *options, size=(1000, 700)):
            page = opened(path.as_uri(), *size, *options)
            page.wait_for_selector("html[data-shown]", state="attached")
            return page

        yield shown


def what_is_shown(page):
    return page.get_attribute("html", "data-shown")


PICTURE = """() => {
  look("wall");
  set("mode", "maximum");
  set("colours", "amplitude");
  drawVolume(camera());
  return element("volume").toDataURL();
}"""


@in_a_browser
def test_a_browser_shows_the_blob_where_it_is(tmp_path, opened):
    _, path = written(tmp_path)
    page = opened(path)
    assert what_is_shown(page) == "volume"
    picture = base64.b64decode(page.evaluate(PICTURE).split(",")[1])
    seen = imread(io.BytesIO(picture))
    rows, columns = np.nonzero((seen[..., 0] > 0.7) & (seen[..., 2] < 0.5))  # orange and yellow
    assert len(rows) > 30
    assert seen[0, 0, :3].max() == 0
    facts = json.loads(Parts(path.read_text("utf-8")).texts["facts"])
    # what the camera shows: the wall and the volume, 1.83 m x 1.3 m (half a voxel more than its centres),
    # from the wall to the farthest depth shown
    sides_m = np.array([1.83, 1.3, facts["shown_m"][1]])
    metres_per_pixel = np.linalg.norm(sides_m) / min(seen.shape[:2])
    x_m = -(columns.mean() + 0.5 - seen.shape[1] / 2) * metres_per_pixel
    y_m = -(rows.mean() + 0.5 - seen.shape[0] / 2) * metres_per_pixel
    assert (x_m, y_m) == pytest.approx(BLOB_M[:2], abs=0.02)  # less than a voxel


KEYS = """() => {
  const press = (key, target = document.body) =>
    target.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
  const steps = [];
  const keep = (name) => steps.push([name, { ...state }]);
  keep("begun");
  for (const key of ["1", "m", "c", "]", ".", "+"]) { press(key); keep(key); }
  press("ArrowLeft"); keep("elsewhere");
  press("ArrowLeft", element("lines")); keep("ArrowLeft");
  return steps;
}"""


@in_a_browser
def test_keys_turn_zoom_and_change_what_is_shown(tmp_path, opened):
    _, path = written(tmp_path)
    page = opened(path)
    steps = dict(page.evaluate(KEYS))
    assert (steps["begun"]["yaw"], steps["begun"]["pitch"], steps["begun"]["mode"]) == (35, 20, "surface")
    assert (steps["1"]["yaw"], steps["1"]["pitch"]) == (0, 0)
    assert steps["m"]["mode"] == "maximum"
    assert steps["c"]["colours"] == "amplitude"
    assert steps["]"]["threshold"] == pytest.approx(steps["begun"]["threshold"] + 0.02)
    assert steps["."]["plane"] == steps["begun"]["plane"] + 1
    assert steps["+"]["zoom"] > 1
    assert steps["elsewhere"]["yaw"] == 0  # arrows scroll the page unless the picture has the focus
    assert steps["ArrowLeft"]["yaw"] == 5
    read = page.evaluate("() => reading(47, 30)")
    assert read.startswith("x 0.510 m, y 0.300 m: brightest at z 1.01 m")
    assert "surface at z 1.000 m" in read


WRITTEN = """() => {
  const { width, height } = element("lines").getBoundingClientRect();
  const pen = element("lines").getContext("2d"), usual = pen.fillText.bind(pen);
  const views = {};
  for (const view of ["wall", "side", "top", "start"]) {
    views[view] = [];
    pen.fillText = (text, x, y) => {
      const half = pen.measureText(text).width / 2;
      views[view].push([text, x - half, y - 6, x + half, y + 6]);
      usual(text, x, y);
    };
    look(view);
    drawLines(camera());
  }
  return [width, height, views];
}"""


@in_a_browser
def test_on_a_phone_words_lie_inside_the_picture_and_not_over_one_another(tmp_path, opened):
    _, path = written(tmp_path)
    width, height, views = opened(path, size=(390, 844)).evaluate(WRITTEN)
    assert width < 390
    for view, words in views.items():
        names = {text for text, *_ in words}
        assert "relay wall" in names
        assert {"wall": {"x (m)", "y (m)"}, "start": {"x (m)", "y (m)"}}.get(view, set()) <= names
        for number, (text, left, top, right, bottom) in enumerate(words):
            assert 0 <= left < right <= width, (view, text)
            assert 0 <= top < bottom <= height, (view, text)
            for other, *box in words[:number]:
                apart = right <= box[0] or left >= box[2] or bottom <= box[1] or top >= box[3]
                assert apart, (view, text, other)


SHAPES = """() => [...document.querySelectorAll("canvas:not(#bar)")].map((canvas) => {
  const { width, height } = canvas.getBoundingClientRect();
  return [canvas.id, width / height, canvas.width / canvas.height];
})"""


@in_a_browser
def test_on_paper_pictures_keep_their_shape_and_nothing_is_to_be_pulled(tmp_path, opened):
    _, path = written(tmp_path)
    page = opened(path)
    page.evaluate("() => { draw = drawSlices = () => {}; }")  # for paper a browser asks for no new drawing
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 720, "height": 1000})  # as wide as A4 inside its margins
    for name, on_paper, drawn in page.evaluate(SHAPES):
        assert on_paper == pytest.approx(drawn, rel=0.02), name
    assert not any(one.is_visible() for one in page.locator("input, button, select").all())


@in_a_browser
def test_without_graphics_slices_are_shown_and_the_reason_said(tmp_path, opened):
    _, path = written(tmp_path)
    page = opened(path, "--disable-3d-apis")
    assert what_is_shown(page) == "slices"
    said = page.inner_text("#message")
    assert said.endswith("WebGL 2 is off or missing. Slices, front view and depths below need none.")


@in_a_browser
def test_a_damaged_page_says_so(tmp_path, opened):
    _, path = written(tmp_path)
    text = path.read_text("utf-8")
    packed = Parts(text).texts["voxels"].strip()
    assert text.count(packed) == 1
    short = base64.b64encode(gzip.compress(b"abc")).decode()
    path.write_text(text.replace(packed, short), "utf-8")
    page = opened(path)
    assert what_is_shown(page) == "nothing"
    assert page.inner_text("#message") == "The file is damaged: voxels are missing."
