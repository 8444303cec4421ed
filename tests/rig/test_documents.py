"""Each document that a verb prints with ``--json`` is as its schema says."""

import json
from pathlib import Path

import jsonschema
import pytest
import typer

from drivers.errors import DeviceNotFoundError
from rig.__main__ import told
from rig.commands import app
from rig.commands.documents import DOCUMENTS, VERSION, Failure, schema

FEW = ("--grid", "4x4", "--spacing", "20cm")
#: Commands in the order in which they make each other's files, and what they print.
COMMANDS = [
    ("scan", "--out", "a.h5", *FEW),
    ("scan", "--dry-run", *FEW),
    ("scan", "--preset", "list"),
    ("version",),
    ("recon", "a.h5"),
    ("recon", "a.h5", "--dry-run"),
    ("recon", "a.h5", "--preview"),
    ("batch", "jobs.toml", "--dry-run"),
    ("info", "a.h5"),
    ("info", "a-volume.h5"),
    ("list", "."),
    ("report", "a.h5"),
    ("stats", "a.h5"),
    ("plot", "a.h5"),
    ("measure", "a-volume.h5"),
    ("measure", "a-volume.h5", "--truth", "scene:letters"),
    ("export", "a-volume.h5", "a.npz"),
    ("export", "a.h5", "a.hdf5"),
    ("info", "a.hdf5"),
    ("import", "a.hdf5", "b.h5"),
    ("doctor",),
    ("init", "--defaults", "--out", "rig.toml"),
    ("info", "rig.toml"),
    ("config", "show"),
    ("devices", "probe"),
    ("laser", "status"),
    ("laser", "off"),
    ("align", "--for", "300ms", "--yes"),
    ("sim", "render", "letters", "c.h5", *FEW),
    ("calibrate", "irf"),
    ("calibrate", "show"),
]


def verbs(command=None, words=()):
    """Yield the words of each verb that has --json."""
    command = command or typer.main.get_command(app)
    for name, one in getattr(command, "commands", {}).items():
        yield from verbs(one, (*words, name))
    if any("--json" in option.opts for option in command.params):
        yield " ".join(words)


def verb_of(command) -> str:
    return max((verb for verb in DOCUMENTS if " ".join(command).startswith(verb)), key=len)


def test_each_verb_that_prints_a_document_has_a_schema():
    assert set(verbs()) == set(DOCUMENTS)


@pytest.mark.parametrize("verb", DOCUMENTS)
def test_schemas_are_valid_and_say_their_version(verb):
    found = schema(verb)
    jsonschema.Draft202012Validator.check_schema(found)
    versions = [
        one["properties"]["schema_version"]["const"]
        for one in found["$defs"].values()
        if "schema_version" in one["properties"]
    ]
    assert set(versions) == {VERSION}


def test_what_verbs_print_is_as_their_schemas_say(rig):
    Path("jobs.toml").write_text('[[job]]\nscans = "a.h5"\n', encoding="utf-8")
    seen = set()
    for command in COMMANDS:
        done = rig(*command, "--json")
        assert done.code == 0, (command, done.err)
        jsonschema.validate(json.loads(done.out), schema(verb_of(command)))
        seen.add(verb_of(command))
    of_scans = {"resume"}  # the document of `rig scan`
    # test_compare_command.py, test_sim_serve.py, test_web_page.py
    elsewhere = {"compare", "sim serve", "watch"}
    assert seen | of_scans | elsewhere >= {verb for verb in DOCUMENTS if not verb.startswith("calibrate ")}


@pytest.mark.parametrize("command", [("recon", "gone.h5"), ("scan", "--no-such-option")])
def test_failures_are_documents_too(rig, command):
    done = rig(*command, "--json")
    assert Failure.model_validate_json(done.out).exit_code == done.code != 0


def test_a_document_with_another_key_is_not_as_its_schema_says(rig):
    document = json.loads(rig("laser", "status", "--json").out)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**document, "more": 1}, schema("laser status"))


def test_a_laser_that_cannot_be_reached_is_to_be_treated_as_emitting(rig):
    """The one document says so, too; no second one follows it."""
    lab = Path(__file__).parents[2] / "configs" / "lab.toml"
    Path("night.toml").write_text(f'extends = "{lab}"\n[laser]\naddress = "/dev/nowhere"\n', encoding="utf-8")
    done = rig("laser", "off", "--config", "night.toml", "--json")
    assert done.code == 4
    assert [one["dark"] for one in json.loads(done.out)["lasers"]] == [False]
    assert "treat the laser at /dev/nowhere as EMITTING: turn its key off by hand, now" in done.err


def test_where_to_look_on_stands_beside_the_failure_it_is_of():
    error = DeviceNotFoundError("laser", "answer", "nothing came", "Check its cable.")
    error.add_note("while leaving: the gate is OPEN.")
    first, second = told(error, " What else is missing: rig doctor").splitlines()
    assert first.endswith("rig doctor")
    assert second == "while leaving: the gate is OPEN."
