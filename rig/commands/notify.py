"""The message at the end of a scan, when the light is dark and the data closed; it makes no scan fail."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from tempfile import TemporaryFile
from typing import Any
from urllib.parse import urlsplit

from rig.commands import console
from rig.errors import InterruptedScanError
from rig.model.config import NotifyConfig

#: The command, and the webhook, each have so long.
LONGEST_S = 10.0
#: Of what a command said, so much is shown when it fails.
MOST_SAID = 200
_WORD = re.compile(r"\{(file|status|photons|sentence)\}")


def announce(to: NotifyConfig, summary: Mapping[str, Any], longest_s: float = LONGEST_S) -> None:
    """Report the end of a scan to whom the configuration names; what fails is a warning.

    Parameters
    ----------
    to
        The configuration's section.
    summary
        A JSON document with ``status`` and ``sentence``, and mostly ``file`` and ``photons``.
    longest_s
        How long the command, and the webhook, may take.
    """
    if to.command:
        _warn_of(f"the command '{to.command[0]}'", _run(_filled_in(to.command, summary), longest_s))
    if to.webhook:
        address = to.webhook.get_secret_value()
        _warn_of(f"the webhook at {urlsplit(address).hostname}", _post(address, summary, longest_s))


def failed(error: Exception, **what: object) -> dict[str, object]:
    """Return the summary of what failed, or was stopped at a question; ``what`` has the file, and more."""
    status = "interrupted" if isinstance(error, InterruptedScanError) else "failed"
    told = " ".join(dict.fromkeys([str(error), *getattr(error, "__notes__", ())]))
    return {**what, "status": status, "error": told, "sentence": f"{what['file']}: {status}: {told}"}


def _warn_of(whom: str, problem: str) -> None:
    if problem:
        console.warn(f"the message about the end was not sent by {whom} ([notify]): {problem}")


def _filled_in(words: tuple[str, ...], summary: Mapping[str, Any]) -> list[str]:
    """Return words with what they name; what is put in is text, in which nothing is replaced again."""

    def value(found: re.Match[str]) -> str:
        said = summary.get(found[1])
        return "" if said is None else str(said).replace("\0", "")

    return [_WORD.sub(value, word) for word in words]


def _run(words: list[str], longest_s: float) -> str:
    """Run a command; return what went wrong."""
    try:
        with (
            TemporaryFile() as said,  # a pipe would be held open by what the command leaves behind
            subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True
            ) as process,
        ):
            try:
                code = process.wait(longest_s)
            except subprocess.TimeoutExpired:
                _kill(process)
                return f"it still ran after {longest_s:g} s, and was stopped"
            said.seek(0)
            last = said.read().decode("utf-8", "replace").strip()[-MOST_SAID:]
    except OSError as problem:
        return problem.strerror or type(problem).__name__
    return f"it ended with {code}{f': {last}' if last else ''}" if code else ""


def _kill(process: "subprocess.Popen[bytes]") -> None:
    """End a command, and what it has begun."""
    if sys.platform == "win32":
        process.kill()
    else:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _post(address: str, summary: Mapping[str, Any], longest_s: float) -> str:
    """Send a document; return what went wrong, without the address.

    In a thread, because a name that is looked up, or an answer that drips, knows no time limit.
    """
    from urllib.error import HTTPError, URLError
    from urllib.request import HTTPRedirectHandler, Request, build_opener

    class NoRedirects(HTTPRedirectHandler):
        """Follows none: a document that is sent on would become a question without it."""

        def redirect_request(self, *_: object) -> None:
            """Follow nothing."""

    body = json.dumps({"schema_version": 1, **summary}, default=str).encode()
    headers = {"Content-Type": "application/json", "User-Agent": "rig"}
    problems: list[str] = []

    def send() -> None:
        try:
            request = Request(address, body, headers, method="POST")
            with build_opener(NoRedirects).open(request, timeout=longest_s):
                problems.append("")
        except HTTPError as problem:
            problems.append(f"it answered {problem.code}")
            problem.close()
        except URLError as problem:
            problems.append(str(problem.reason))
        except Exception as problem:  # its words may hold the address
            problems.append(type(problem).__name__)

    sender = threading.Thread(target=send, daemon=True)
    try:
        sender.start()
    except RuntimeError as problem:  # the system has no more threads
        return str(problem)
    sender.join(longest_s)
    return problems[0] if problems else f"no answer came in {longest_s:g} s"
