"""The message at the end of a scan: who gets it, what it says, and that no file holds its address."""

import json
import os
import shutil
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from rig.commands.notify import announce
from rig.files import ScanFile
from rig.model.config import NotifyConfig, load, recorded
from rig.model.written import as_toml

#: Writes its arguments, and whether the journal of the scan in the first of them is still there.
TOLD = """
import json, os, sys
words = sys.argv[2:]
json.dump({"words": words, "open": os.path.exists(words[0] + "-journal")}, open(sys.argv[1], "w"))
"""
SECRET = "s3cr3t-t0p1c"
GRID = ("--grid", "3x2", "--spacing", "20cm", "--exposure", "1ms")


class Hook(BaseHTTPRequestHandler):
    """Keeps the documents that are sent, and answers as it was told to."""

    def do_POST(self):
        self.server.documents.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        time.sleep(self.server.late_s)
        self.send_response(self.server.code)
        self.send_header("Location", "/elsewhere")
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture
def hook():
    server = HTTPServer(("127.0.0.1", 0), Hook)
    server.documents, server.code, server.late_s = [], 200, 0.0
    server.address = f"http://127.0.0.1:{server.server_port}/{SECRET}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


def configured(folder, hook, more=""):
    """Return a configuration of the simulated rig that notifies a program and a webhook."""
    words = [
        sys.executable,
        "-c",
        TOLD,
        str(folder / "told.json"),
        "{file}",
        "{status}",
        "{photons}",
        "{sentence}",
    ]
    path = folder / "rig.toml"
    path.write_text(
        f'[simulation]\n{more}\n[tcspc]\nbins = 1500\nbin_width = "32ps"\n[notify]\n'
        f"command = {json.dumps(words)}\nwebhook = {json.dumps(hook.address)}\n"
    )
    return path


def told(folder):
    return json.loads((folder / "told.json").read_text())


def test_a_scan_that_ended_is_reported_when_its_file_is_closed(rig, tmp_path, hook):
    config = configured(tmp_path, hook)
    done = rig("scan", "--config", config, *GRID, "--out", "a.h5", "--json")
    assert done.code == 0
    said = json.loads(done.out)
    assert hook.documents == [said]
    assert told(tmp_path) == {
        "words": ["a.h5", "complete", str(said["photons"]), said["sentence"]], "open": False
    }  # fmt: skip
    assert said["sentence"].startswith("a.h5: complete (all positions measured), 6 positions")
    config.unlink()
    (tmp_path / "told.json").unlink()
    for path in tmp_path.iterdir():
        assert SECRET.encode() not in path.read_bytes(), path
    with ScanFile(tmp_path / "a.h5") as scan:
        assert scan.config.notify == NotifyConfig()
    assert SECRET not in done.err


def test_a_scan_that_was_stopped_is_reported_and_resumed_without_orders_from_its_file(rig, tmp_path, hook):
    config = configured(tmp_path, hook)
    long = ("--grid", "48x40", "--spacing", "3cm", "--exposure", "10ms")  # more than half a second
    assert rig("scan", "--config", config, *long, "--until", "time 0.5s", "--out", "a.h5").code == 0
    assert told(tmp_path)["words"][1] == "interrupted"
    (tmp_path / "told.json").unlink()
    shutil.copy(tmp_path / "a.h5", tmp_path / "b.h5")
    assert rig("resume", "a.h5").code == 0
    assert not (tmp_path / "told.json").exists()
    assert len(hook.documents) == 1
    hook.code = 302  # a document is not sent on: that is a warning, and the scan is complete
    resumed = rig("resume", "b.h5", "--config", config)
    assert resumed.code == 0
    assert "the webhook at 127.0.0.1 ([notify]): it answered 302" in resumed.err
    assert SECRET not in resumed.err + resumed.out
    assert [one["status"] for one in hook.documents] == ["interrupted", "complete"]


def test_what_fails_is_reported_with_its_reason(rig, tmp_path, hook):
    config = configured(tmp_path, hook, "[simulation.by_hand]\nbias = false\n")
    failed = rig("scan", "--config", config, *GRID, "--out", "a.h5")
    assert failed.code in (3, 4)
    assert (hook.documents[0]["status"], hook.documents[0]["photons"]) == ("failed", 0)
    assert hook.documents[0]["error"] in failed.err
    channels = "".join(f'[[channels]]\nname = "{name}"\ninput = {name}\n' for name in (0, 1))
    config.write_text(config.read_text() + channels)
    assert rig("calibrate", "all", "--config", config).code == 2
    assert hook.documents[1]["file"] == str(tmp_path / "calibrations")
    assert told(tmp_path)["words"][1:3] == ["failed", ""]


SUMMARY = {"file": "a.h5", "status": "complete", "photons": 7, "sentence": "a {file} $(touch made) `x`"}


def test_words_are_replaced_once_and_no_shell_sees_them(tmp_path):
    words = (sys.executable, "-c", TOLD, str(tmp_path / "told.json"), "{file}", "<{sentence}>", "{other}")
    announce(NotifyConfig(command=words), SUMMARY)
    assert told(tmp_path)["words"] == ["a.h5", "<a {file} $(touch made) `x`>", "{other}"]


def test_what_hangs_is_ended_and_what_fails_is_a_warning(hook, capsys):
    hook.late_s = 1.0
    code = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(60)'])"
    began_s = time.monotonic()
    slow = NotifyConfig(command=(sys.executable, "-c", code), webhook=hook.address)
    announce(slow, SUMMARY, longest_s=0.3)
    assert time.monotonic() - began_s < 10  # of a busy machine; else it would be a minute
    said = capsys.readouterr().err
    assert "it still ran after 0.3 s, and was stopped" in said
    assert "127.0.0.1" in said
    announce(NotifyConfig(command=("no-such-program",)), SUMMARY)
    assert "by the command 'no-such-program' ([notify]): No such file" in capsys.readouterr().err
    failing = NotifyConfig(command=(sys.executable, "-c", "import sys; sys.exit('no network')"))
    announce(failing, SUMMARY)
    assert "it ended with 1: no network" in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong", ["ftp://host/x", "https:///x", "https://host/a b", "https://[x/", "http://h:x/"]
)
def test_a_wrong_address_is_refused_and_not_shown(tmp_path, rig, wrong):
    (tmp_path / "rig.toml").write_text(f'[simulation]\n[notify]\nwebhook = "{wrong}"\n')
    refused = rig("scan", "--config", "rig.toml", *GRID)
    assert refused.code == 2
    assert "notify.webhook" in refused.err
    assert wrong not in refused.err


def test_no_record_gives_orders(tmp_path, hook):
    config = load(configured(tmp_path, hook))
    assert config.notify.command
    written = config.model_dump_json()
    assert SECRET not in written + as_toml(config) + repr(config.notify.webhook)
    forged = {**json.loads(written), "notify": {"command": ["touch", "made"]}}
    assert recorded(json.dumps(forged)).notify == NotifyConfig()
    assert not config.differences(recorded(written))
    assert os.listdir(tmp_path) == ["rig.toml"]
