"""TOML files of people: read whole, within limits, and refused in words."""

import re
import tomllib
from pathlib import Path

from rig.errors import ConfigError
from rig.model.presets import Table

#: A larger file is none that a person wrote; a configuration with a thousand channels has a tenth of it.
MOST_BYTES = 1_000_000
#: A key of more than 100 words: reading it would take time with the square of their number.
_LONG_KEY = re.compile(r"^[^#=\n]*(?:\.[^.=\n]*){100}", re.MULTILINE)


def read_toml(path: Path, what: str, remedy: str) -> Table:
    """Return what a TOML file holds.

    Parameters
    ----------
    path
        The file.
    what
        What it is to be, e.g. ``configuration``.
    remedy
        What a person does where it cannot be read.

    Raises
    ------
    ConfigError
        If it cannot be read, is too large, nested too deeply, no text or no TOML.
    """
    try:
        if path.is_fifo():
            raise ConfigError(f"{path}: is a pipe, which can be read only once; write the {what} to a file")
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        text = content.decode("utf-8-sig")  # editors on Windows put a mark before the text
        if len(content) > MOST_BYTES or _LONG_KEY.search(text):
            raise ConfigError(
                f"{path}: is not a {what}: a {what} has at most {MOST_BYTES / 1e6:g} MB, and short keys"
            )
        return tomllib.loads(text)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}). {remedy}") from None
    except RecursionError:
        raise ConfigError(f"{path}: is not a {what}: its values are nested too deeply") from None
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path}: is not text in UTF-8 (its byte {error.start} is not valid); save it as UTF-8"
        ) from None
    except ValueError as error:  # also a path with NUL, numbers of thousands of digits
        raise ConfigError(f"{path}: is not valid TOML: {error}") from None
