"""Section of what is reported, and to whom, when a scan ends: local matters that no data file holds."""

from urllib.parse import urlsplit

from pydantic import SecretStr, field_validator

from rig.model.config.section import Section


class NotifyConfig(Section):
    """Where a message is sent when a scan, or all calibrations, end or stop; nowhere by default.

    It is taken from the configuration alone, is in no data file, and is not taken from one: a file is data,
    never an order. An address or a command often holds a secret.
    """

    command: tuple[str, ...] = ()
    """A program and its arguments, run without a shell; `{file}`, `{status}`, `{photons}` and `{sentence}` in
    them are replaced."""
    webhook: SecretStr | None = None
    """Where a JSON document is sent by HTTP POST."""

    @field_validator("command")
    @classmethod
    def _names_a_program(cls, words: tuple[str, ...]) -> tuple[str, ...]:
        if words and not words[0].strip():
            raise ValueError(
                'the first word is the program, e.g. ["ntfy", "publish", "my-rig", "{sentence}"]'
            )
        if any("\0" in word for word in words):
            raise ValueError("a word holds a zero character, which cannot be given to a program")
        return words

    @field_validator("webhook")
    @classmethod
    def _is_of_the_web(cls, address: SecretStr | None) -> SecretStr | None:
        if address is not None and not _of_the_web(address.get_secret_value()):
            raise ValueError(  # without the address
                "it is an address such as https://ntfy.example/topic, in ASCII and without spaces"
            )
        return address


def _of_the_web(address: str) -> bool:
    try:
        parts = urlsplit(address)
        parts.port  # noqa: B018 - raises where it is no number
    except ValueError:
        return False
    plain = all("!" <= one <= "~" for one in address)
    return plain and parts.scheme in ("http", "https") and bool(parts.hostname)
