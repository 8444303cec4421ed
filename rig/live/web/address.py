"""Where a page is served, and who may see it there."""

import re
import secrets
import socket
from dataclasses import dataclass, replace
from importlib.util import find_spec

from rig.errors import UsageError
from rig.install import install_extra

#: The port that is taken where none is given; another where that is taken.
PORT = 8642
#: Names of this computer that no other computer can reach.
LOOPBACK = ("127.0.0.1", "localhost", "::1")
#: What is said of the address where nothing is.
HERE = LOOPBACK[0]
_GIVEN = re.compile(r"(?P<host>\[[0-9a-fA-F:.]+\]|[\w.-]*)(:(?P<port>\d{1,5}))?")
_TOKEN_BYTES = 16


@dataclass(frozen=True)
class Address:
    """Where a page is served.

    Attributes
    ----------
    host, port
        The name or number of a network interface of this computer, and the port.
    token
        What somebody has to know to see the page; empty where only this computer reaches it.
    asked
        Whether this port was asked for; otherwise any will do where it is taken.
    """

    host: str
    port: int
    token: str = ""
    asked: bool = True

    @property
    def family(self) -> socket.AddressFamily:
        """The kind of network."""
        return socket.AF_INET6 if ":" in self.host else socket.AF_INET

    @property
    def everywhere(self) -> bool:
        """Whether all interfaces of this computer are meant, whatever their names."""
        return self.host in ("0.0.0.0", "::")

    @property
    def url(self) -> str:
        """What is typed into a browser, with the token."""
        name = socket.gethostname() if self.everywhere else self.host
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{self.port}/" + (f"?token={self.token}" if self.token else "")

    def listening(self) -> socket.socket:
        """Return a socket that listens there.

        Raises
        ------
        OSError
            If the port was asked for and is taken, or no interface of this computer has this name.
        """
        try:
            return socket.create_server((self.host, self.port), family=self.family)
        except OSError:
            if self.asked:
                raise
            return socket.create_server((self.host, 0), family=self.family)

    def at(self, port: int) -> "Address":
        """Return the same at a port."""
        return replace(self, port=port, asked=True)


def address(given: str) -> Address:
    """Return where a page will be served; where no port is given, the socket that listens has it.

    Parameters
    ----------
    given
        ``HOST:PORT`` or ``HOST``. Where other computers reach it, a token is made.

    Raises
    ------
    UsageError
        If it is no address, or nothing can be served there, or the packages for it are not installed.
    """
    require_installed()
    parts = _GIVEN.fullmatch(given)
    port = int(parts["port"]) if parts and parts["port"] else None
    if not parts or (port is not None and not 0 < port < 2**16):
        raise UsageError(f"--web {given}: this is not an address; write HOST:PORT, e.g. --web 0.0.0.0:{PORT}")
    host = parts["host"].strip("[]") or HERE
    token = "" if host in LOOPBACK else secrets.token_urlsafe(_TOKEN_BYTES)
    found = Address(host, PORT if port is None else port, token, asked=port is not None)
    try:
        found.listening().close()
    except OSError as error:
        raise UsageError(
            f"--web {given}: no page can be served there ({error.strerror or error}); give another port, or "
            "the name of an interface of this computer"
        ) from None
    return found


def require_installed() -> None:
    """Raise UsageError unless the packages are there that serve a page."""
    if missing := [name for name in ("starlette", "uvicorn") if find_spec(name) is None]:
        raise UsageError(
            f"a page in the browser needs {' and '.join(missing)}, which this Python lacks: "
            f"{install_extra('web')}; --live shows the same in a window and as pictures"
        )
