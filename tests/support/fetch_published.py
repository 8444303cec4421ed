"""Fetch measurements that others published, and import them, for the tests that image them.

    python tests/support/fetch_published.py FOLDER [--from ADDRESS]
    RIG_TEST_DATA=FOLDER python -m pytest

FOLDER/original gets the files as published, each held against its SHA-256; FOLDER/scans gets what
``rig import`` makes of them. Without internet, ADDRESS is a folder or a server that holds the files as
FOLDER/original does, for example ``file:///data/original``. The data belongs to its authors, most of it
without a licence: use it, do not pass it on.
"""

import argparse
import hashlib
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

_GITHUB = "https://raw.githubusercontent.com"
_LCT = "/chenyuege/C-NLOS-imaging-based-on-LCT/3613ea534235accc60c35244ea0d33bdba84a8a6/confocal_nlos_code"
_AHN = "/ByeongjooAhn/conv_nlos/509f9f2c9ecf914bc250836c979d608b37f68952/data"
_XIAO = "/XiaoLeping/NLOS_Code_Hybrid_Superresolution/74dbf8862ab3e33627925376109544fbd9ea325e/dataset_18m"
_FOUR = "/hy520484/general-NLOS/5106c57e9e05c4543826318d9fc32c1f4adfa127/public_data/demo_code/data/figure_4"


@dataclass(frozen=True)
class Scene:
    """Files of one measurement, the first of which is imported.

    ``files`` gives for each path below ``original`` its address and its SHA-256; ``importing`` is what the
    files do not say themselves.
    """

    files: dict[str, tuple[str, str]]
    importing: tuple[str, ...] = ()


SCENES = {
    "lct_su": Scene(
        {
            "lct/data_s_u.mat": (
                f"{_GITHUB}{_LCT}/data_s_u.mat",
                "11a94722540e046ba3d86f7c00108948d1781428939302fd0e829d784a7f8f21",
            )
        },
        ("--bin-width", "4ps"),
    ),
    "lct_dot_chart_40cm": Scene(
        {
            "lct/data_dot_chart_40cm.mat": (
                f"{_GITHUB}{_LCT}/data_dot_chart_40cm.mat",
                "b916e441fb005d9073f1d181d68611c7bc7203f1f2bce1c535b38d95b5b0189a",
            )
        },
        ("--bin-width", "4ps"),
    ),
    "ahn_2019": Scene(
        {
            "ahn/2019_transient.mat": (
                f"{_GITHUB}{_AHN}/2019_transient.mat",
                "106de461a47e54fb513373e584560ab098d77a60ceb863aa6d2d568051208617",
            )
        }
    ),
    "xiao18m_L": Scene(
        {
            "xiao18m/4.mat": (
                f"{_GITHUB}{_XIAO}/4.mat",
                "d03c5d26e86213987ae95a018fd89f78460c98253b05ba9781d728964019c8b8",
            )
        },
        ("--bin-width", "32ps", "--wall-size", "0.82m"),
    ),
    "phasor_figure4_nonconfocal": Scene(
        {
            "cc_socr/figure_4/full/sub_Sig.mat": (
                f"{_GITHUB}{_FOUR}/full/sub_Sig.mat",
                "74b44de9efd8686b31d4459de35c2c6fdbdc57102cb26bcf1b2398de21a3d8ae",
            ),
            "cc_socr/figure_4/full/C_i.mat": (
                f"{_GITHUB}{_FOUR}/full/C_i.mat",
                "5a7a3893bdf3f77c293b4bb148d95a4665852a5e621d39d38f861a6e80809672",
            ),
            "cc_socr/figure_4/full/C_d.mat": (
                f"{_GITHUB}{_FOUR}/full/C_d.mat",
                "680ad1a5167ae980f293e027b7cdacab4e584394d1ac3531b977db286e06e79a",
            ),
        },
        ("--bin-width", "16ps", "--wall-size", "1.26m"),
    ),
}


class FetchError(Exception):
    """A measurement that is not here, and why."""


def fetch(name: str, scene: Scene, folder: Path, mirror: str | None = None) -> Path:
    """Bring a scene's files into ``folder``, import them, and return the scan file.

    What is there already, with its right digest, is not fetched again.

    Raises
    ------
    FetchError
        If a file cannot be fetched, is another one than it was, or is refused by ``rig import``. No file is
        left in its place then.
    """
    for path, (address, digest) in scene.files.items():
        _bring(folder / "original" / path, f"{mirror}/{path}" if mirror else address, digest)
    scan = folder / "scans" / f"{name}.h5"
    if not scan.exists():
        scan.parent.mkdir(parents=True, exist_ok=True)
        original = folder / "original" / next(iter(scene.files))
        command = [sys.executable, "-m", "rig", "import", original, scan, *scene.importing]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise FetchError(f"rig import refused {original}: {done.stderr.strip()}")
    return scan


def _bring(target: Path, address: str, digest: str) -> None:
    """Write what lies at ``address`` to ``target``, whole and as it was when the digest was taken."""
    if target.exists() and hashlib.sha256(target.read_bytes()).hexdigest() == digest:
        return
    try:
        with urlopen(address, timeout=60) as answer:
            content = answer.read()
    except (URLError, OSError) as error:
        raise FetchError(f"{address} cannot be fetched: {error}. Try again, or give --from") from error
    found = hashlib.sha256(content).hexdigest()
    if found != digest:
        raise FetchError(
            f"{address} is another file than it was: its SHA-256 is {found}, not {digest}. It is not kept"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(target.name + ".part")
    part.write_bytes(content)
    part.replace(target)


def main() -> int:
    """Fetch all scenes; one that fails does not keep the others."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="where the data goes; outside the project")
    parser.add_argument("--from", dest="mirror", metavar="ADDRESS", help="take the files from there")
    asked = parser.parse_args()
    failed = 0
    for name, scene in SCENES.items():
        try:
            print(fetch(name, scene, asked.folder.resolve(), asked.mirror and asked.mirror.rstrip("/")))
        except FetchError as error:
            print(f"{name}: {error}", file=sys.stderr)
            failed += 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
