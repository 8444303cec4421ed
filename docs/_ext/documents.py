"""The page of all JSON documents, from their models, and their JSON Schemas."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pages_made import first_paragraph, flat, table, write
from pydantic import BaseModel

from rig.commands.documents import DOCUMENTS, Failure, schema

_HEAD = """# JSON documents

With `--json` a verb prints exactly one document on stdout, also when it fails. `schema_version` is 1. Keys
may be added within a version; a key that goes, or means something else, makes a new version. SI numbers have
their unit in the key's name; a value that is not known is `null`.

Each verb has a JSON Schema. The models of which they are made are in `rig/commands/documents.py`; the
program's tests hold what is printed against them.
"""


def write_schemas(folder: Path) -> None:
    """Write a JSON Schema for each verb."""
    for verb in DOCUMENTS:
        write(folder / f"{dashed(verb)}.json", json.dumps(schema(verb), indent=2) + "\n")


def dashed(words: str) -> str:
    """Return the words of a verb as a file name."""
    return words.replace(" ", "-")


def page() -> str:
    """Return the page of all documents."""
    parts = [_HEAD]
    told = set()
    for verb, model in DOCUMENTS.items():
        parts += [f"## rig {verb}\n", f"[JSON Schema](schemas/{dashed(verb)}.json)\n"]
        for one in flat(model):
            if one in told:
                same = first_paragraph(one.__doc__)
                parts.append(f"The document is that of [{same}](#{one.__name__.lower()})\n")
                continue
            told.add(one)
            parts += [f"({one.__name__.lower()})=\n", first_paragraph(one.__doc__) + "\n", _document(one)]
    parts += ["## A failure\n", first_paragraph(Failure.__doc__) + "\n", _document(Failure)]
    return "\n".join(parts)


def _document(model: type[BaseModel]) -> str:
    return table(("key", "type", "what it is"), _rows(model.model_json_schema()))


def _rows(
    found: dict[str, Any], of: dict[str, Any] | None = None, before: str = ""
) -> Iterator[tuple[str, str, str]]:
    """Yield a row for each key, those of inner objects by their path."""
    of = of or found
    for name, one in of.get("properties", {}).items():
        if name == "schema_version":
            continue
        kind, inner = _type(found, one)
        yield f"`{before}{name}`", kind, one.get("description", "").replace("None", "null")
        if inner:
            yield from _rows(found, inner, f"{before}{name}{_within(kind)}.")


def _within(kind: str) -> str:
    """Return what stands between a key and those within it."""
    return "[]" if kind.startswith("array") else ".NAME" if kind.startswith("object by name") else ""


def _type(found: dict[str, Any], one: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    """Return what a value is, and the object that is in it, if any."""
    if "$ref" in one:
        return "object", found["$defs"][one["$ref"].rpartition("/")[2]]
    if "anyOf" in one:
        kinds = [_type(found, each) for each in one["anyOf"]]
        return " or ".join(kind for kind, _ in kinds), next((inner for _, inner in kinds if inner), None)
    if "enum" in one:
        return ", ".join(f"`{each}`" for each in one["enum"]), None
    if "const" in one:
        return f"`{one['const']}`", None
    if one.get("type") == "array" and "prefixItems" in one:
        return f"array of {len(one['prefixItems'])}: {_type(found, one['prefixItems'][0])[0]}", None
    if one.get("type") == "array" and "items" in one:
        kind, inner = _type(found, one["items"])
        return f"array of: {kind}", inner
    if one.get("type") == "object" and isinstance(one.get("additionalProperties"), dict):
        kind, inner = _type(found, one["additionalProperties"])
        return f"object by name, of: {kind}", inner
    return one.get("type", "any"), None
