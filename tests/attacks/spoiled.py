"""Good input, spoiled: text, JSON trees and bytes."""

import copy
import json
import re
from contextlib import suppress
from random import Random
from typing import Any

NUMBERS = [
    "0", "-0", "-1", "1", "1e308", "1e400", "-1e400", "1e-320", "1e-400", "nan", "inf", "-inf", "99999999999",
    "9" * 5000, "9" * 310, "1" + "0" * 400, "٣", "²", "½", "1_000", "0x10", "1.7976931348623157e308",
    "2147483648", "18446744073709551616", ".", "-", "1.", "1e", "1e+", "00012", "9999999", "0.0000001",
]  # fmt: skip
WORDS = [
    "", " ", "\0", "\n", "\r", "\x1b[31m", "\x07", "\udcff", "\ud800", "é", "💥", "\u202e", "%s%n",
    "[/red]", "{}", "../..", "A" * 10_000, "dB", "mdegC", "degC", "delta_degC", "dBm", "Np", "µ", "''",
    '"', "\\", "/",
    "x" * 300,    "[" * 5_000, "{" * 5_000, "true", "null", ":", ",", ";", "=", "#", "°", "∞", "−5", "None",
]  # fmt: skip
VALUES: list[Any] = [
    None, True, False, 0, -1, 1e308, -1e308, 10**400, 5e-324, 2**63, 2**31, "", "nan", "x" * 10_000,
    [], {}, [[]], [None], {"": None}, {"kind": {}}, [1e308] * 3, "2526-01-01T00:00:00Z",
    "9999-12-31T23:59:59Z", "\udcff",
    float("nan"), float("inf"), [0] * 1000, "\0", [[[[]]]],
]  # fmt: skip


def spoiled_text(random: Random, good: str, rounds: int = 4) -> str:
    """Return text with up to so many spoiled places."""
    text = good
    for _ in range(random.randint(1, rounds)):
        at = random.randint(0, len(text))
        to = min(len(text), at + random.choice([0, 1, 1, 2, 5, 30]))
        numbers = list(re.finditer(r"\d+(\.\d*)?", text)) if random.random() < 0.4 else []
        match random.randrange(5):
            case _ if numbers:
                hit = random.choice(numbers)
                text = text[: hit.start()] + random.choice(NUMBERS) + text[hit.end() :]
            case 0:
                text = text[:at] + text[to:]
            case 1:
                text = text[:at] + text[at:to] * random.choice([2, 3, 100]) + text[to:]
            case 2:
                text = text[:at] + random.choice(WORDS) + text[to:]
            case 3:
                text = (
                    text[:at]
                    + chr(random.choice([random.randrange(128), random.randrange(0xD7FF)]))
                    + text[to:]
                )
            case 4:
                text = text[:at] if random.random() < 0.3 else text[at:] + text[:at]
    return text


def spoiled_tree(random: Random, good: Any, rounds: int = 3) -> Any:
    """Return a copy of a JSON tree with up to so many values that are others, missing, or too many."""
    tree = copy.deepcopy(good)
    for _ in range(random.randint(1, rounds)):
        parent, key = _somewhere(random, tree)
        if parent is None:
            return random.choice(VALUES)
        match random.randrange(6):
            case 0 if isinstance(parent, dict):
                del parent[key]
            case 1 if isinstance(parent, dict):
                parent[random.choice(WORDS)] = random.choice(VALUES)
            case 2 if isinstance(parent, list):
                del parent[key]
            case 3 if isinstance(parent[key], float | int) and not isinstance(parent[key], bool):
                factor = random.choice([-1, 0, 1e9, 1e-9, 10**30])
                with suppress(OverflowError):  # what this program cannot write, it need not read
                    parent[key] *= factor
            case _:
                parent[key] = copy.deepcopy(random.choice(VALUES))
    return tree


def deep(random: Random) -> str:
    """Return JSON that is nested far deeper than any reader's stack."""
    depth = random.choice([100, 1_000, 10_000, 100_000])
    return random.choice(
        ["[" * depth, "[" * depth + "]" * depth, '{"a":' * depth, '{"a":' * depth + "1" + "}" * depth]
    )


def spoiled_json(random: Random, good: Any) -> str:
    """Return spoiled JSON: its tree, its text, or deep nesting."""
    kind = random.random()
    if kind < 0.02:
        return deep(random)
    if kind < 0.2:
        return spoiled_text(random, json.dumps(good))
    return json.dumps(spoiled_tree(random, good))


def spoiled_bytes(random: Random, good: bytes, rounds: int = 4) -> bytes:
    """Return bytes of which some are others, missing or too many."""
    data = bytearray(good)
    for _ in range(random.randint(1, rounds)):
        at = random.randint(0, len(data))
        match random.randrange(5):
            case 0 if data:
                data[at % len(data)] = random.randrange(256)
            case 1 if data:
                data[at % len(data)] ^= 1 << random.randrange(8)
            case 2:
                del data[at : at + random.choice([1, 2, 10, 10_000])]
            case 3:
                data[at:at] = random.randbytes(random.choice([1, 4, 40]))
            case _:
                data[at : at + 4] = random.choice(
                    [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\0", b"nan\n"]
                )
    return bytes(data)


def _somewhere(random: Random, tree: Any) -> tuple[Any, Any]:
    """Return a place in a tree: what holds it, and by which key; None where the tree is a leaf."""
    parent, key = None, None
    node = tree
    while isinstance(node, dict | list) and node and (parent is None or random.random() < 0.8):
        parent, key = node, random.choice(list(node) if isinstance(node, dict) else range(len(node)))
        node = parent[key]
    return parent, key
