"""Joining a cluster: one that runs, or workers of this computer for as long as they are needed."""

import json
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING

from recon.computer import cores, memory_bytes
from rig.cluster.awaited import GONE
from rig.errors import RefusedError, UsageError, reason
from rig.install import install_extra
from rig.whole import read_whole

if TYPE_CHECKING:
    from distributed import Client, Security

#: How a cluster is named.
FORMS = "local, local:4, tcp://HOST:8786, tls://HOST:8786, or the name of a scheduler's FILE.json"
#: A scheduler's address.
SCHEDULER = r"(tcp|tls|ucx|ws|wss)://\S+"
#: How long a scheduler may take to answer.
PATIENCE_S = 20
#: How long workers of this computer may take to start: other programs want the processors, too.
STARTING_S = 120
_QUIET = {
    # what workers and scheduler say of themselves is not a result, and what matters comes as an error
    "logging": dict.fromkeys(("distributed", "distributed.client", "tornado"), "critical"),
    "distributed.admin.large-graph-warning-threshold": "1GB",
}


def local_workers(address: str) -> int | None:
    """Return how many workers of this computer an address asks for; None where it names a cluster.

    Raises
    ------
    UsageError
        If it is no address.
    """
    if match := re.fullmatch(r"local(?::(\d+))?", address):
        number, most = int(match.group(1) or cores()), 4 * cores()
        if not 1 <= number <= most:
            raise UsageError(
                f"--cluster {address}: there are {cores()} cores here to be used; ask for 1 to {most} workers"
            )
        return number
    if re.fullmatch(SCHEDULER, address) or address.endswith(".json"):
        return None
    raise UsageError(f"--cluster '{address}' is not a cluster; write {FORMS}")


@contextmanager
def joined(address: str, *, dashboard: bool = False) -> "Iterator[Client]":
    """Join a cluster; workers that were started for it end with the block, however that ends.

    Parameters
    ----------
    address
        One of `FORMS`.
    dashboard
        Whether local workers have dask's page, on a free port.

    Raises
    ------
    UsageError
        If it is no address, dask is not installed, or nobody answers there.
    """
    number = local_workers(address)
    try:
        import dask
    except ImportError as error:
        raise UsageError(
            f"--cluster needs dask and distributed ({error}): {install_extra('cluster')}"
        ) from None
    with dask.config.set(_QUIET), _named(address) if number is None else _local(number, dashboard) as client:
        yield client


@contextmanager
def _local(number: int, dashboard: bool) -> "Iterator[Client]":
    from distributed import Client, LocalCluster

    try:
        with _without_ctrl_c():  # the threads that dask starts, and through them the workers
            cluster = LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                processes=True,
                memory_limit=_share_bytes(number),
                dashboard_address="127.0.0.1:0",  # where its server of numbers is, too: any port that is free
                scheduler_kwargs={"dashboard": dashboard},
                env={"NUMBA_NUM_THREADS": "1", "DASK_LOGGING__DISTRIBUTED": "critical"},
                silence_logs="CRITICAL",
            )
    except (OSError, RuntimeError) as error:
        raise RefusedError(f"no workers can be started here: {reason(error)}; leave --cluster out") from error
    with cluster, Client(cluster, set_as_default=False) as client:
        cluster.scale(number)
        try:
            client.wait_for_workers(number, timeout=STARTING_S)
        except TimeoutError:
            raise RefusedError(
                f"of {number} workers {len(client.nthreads())} started within {STARTING_S} s: this computer "
                "may lack memory, files or processes for them (ulimit); ask for fewer, or leave --cluster out"
            ) from None
        yield client


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Start threads and processes that never get Ctrl-C, which a terminal sends to all of them."""
    if sys.platform == "win32":
        yield
        return
    # it lets Ctrl-C through again in the thread in which it starts
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _share_bytes(number: int) -> int:
    return int(memory_bytes() / number)


@contextmanager
def _named(address: str) -> "Iterator[Client]":
    from distributed import Client
    from distributed.client import ClosedClientError
    from distributed.comm import CommClosedError

    scheduler = scheduler_of(address)
    security = _security(address, scheduler)
    try:
        client = Client(scheduler, timeout=PATIENCE_S, security=security, set_as_default=False)
    except (OSError, ValueError, TypeError, KeyError, RuntimeError) as error:
        raise UsageError(
            f"--cluster {address}: no scheduler answers within {PATIENCE_S} s ({error}); check the address, "
            "that the scheduler runs, and whether it wants tls:// in place of tcp://"
        ) from error
    with client:
        if not client.nthreads():
            raise RefusedError(f"--cluster {address}: its scheduler has no workers; start some: dask worker")
        try:
            yield client
        except (ClosedClientError, CommClosedError) as error:  # what was sent to it, or taken back
            raise RefusedError(GONE) from error


def scheduler_of(address: str) -> str:
    """Return a scheduler's address: as it was given, or from the file that the scheduler wrote."""
    if not address.endswith(".json"):
        return address
    try:
        found = json.loads(read_whole(Path(address)))["address"]
    except OSError as error:
        raise UsageError(
            f"--cluster {address} cannot be read: {reason(error)}; the scheduler writes it "
            "(dask scheduler --scheduler-file FILE.json)"
        ) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        found = None
    if not isinstance(found, str) or not re.fullmatch(SCHEDULER, found):
        raise UsageError(
            f"--cluster {address} has no scheduler's address; name the file that a scheduler wrote "
            "(dask scheduler --scheduler-file FILE.json)"
        )
    return found


def _security(address: str, scheduler: str) -> "Security":
    """Return how a scheduler is spoken to; refuse TLS without certificates, for which dask has no words.

    Dask would read the files of certificates for other addresses too, which need none.
    """
    import dask
    from distributed import Security

    if not scheduler.startswith(("tls:", "wss:")):
        encrypted = bool(dask.config.get("distributed.comm.require-encryption"))
        return Security(encrypted, tls_ca_file=None, tls_client_cert=None, tls_client_key=None)
    security = Security()
    try:
        known = security.get_connection_args("client")["ssl_context"]
    except (OSError, ValueError) as error:  # a bad certificate is an OSError (ssl.SSLError)
        raise UsageError(
            f"--cluster {address}: dask's certificates cannot be used: {error}; check distributed.comm.tls "
            "in dask's configuration (docs/cluster.md, Security)"
        ) from error
    if known is None:
        raise UsageError(
            f"--cluster {address} needs certificates, and dask's configuration has none; set "
            "distributed.comm.tls there (docs/cluster.md, Security)"
        )
    return security
