"""Sections and keys as files and scans of earlier programs have them."""

from typing import Any

#: Sections as they were called before their kind was a choice, and keys that have gone to `channels` since.
_OLDER_SECTIONS = {"hydraharp": "tcspc", "spad": "detector"}
_OLDER_KEYS = {
    ("tcspc", "input_channel"): "input",
    ("detector", "spot"): "spot",
    ("detector", "spot_m"): "spot_m",
}


def with_kinds(table: dict[str, Any]) -> dict[str, Any]:
    """Return a configuration of an older program, as a file or a scan holds it, in the present sections."""
    table = {_OLDER_SECTIONS.get(name, name): value for name, value in table.items()}
    of_channel: dict[str, Any] = {}
    for (section, key), channel_key in _OLDER_KEYS.items():
        values = table.get(section)
        if isinstance(values, dict) and key in values:
            of_channel[channel_key] = values[key]
            table[section] = {name: value for name, value in values.items() if name != key}
    return {**table, "channels": [of_channel]} if of_channel and "channels" not in table else table
