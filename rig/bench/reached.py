"""The other side of a served bench: how the program that scans reaches what another process serves."""

import errno
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from drivers.daq.board import SharedBoard
from drivers.errors import DeviceNotFoundError, LinkError
from rig.bench.simulated import simulated_family
from rig.model.config import HarpConfig


@contextmanager
def detector_at(address: str) -> Iterator[object]:
    """Give a pyusb backend on whose bus the served detector is plugged in.

    Raises
    ------
    DeviceNotFoundError, LinkError
        If it is not there, or another program uses it.
    """
    from simulators.wire.served.detector import served_detector

    with ExitStack() as stack:
        try:
            backend = stack.enter_context(served_detector(address))
        except OSError as problem:
            raise _not_reached(f"served detector at {address}", problem) from problem
        yield backend


@contextmanager
def timing_at(address: str, harp: HarpConfig) -> Iterator[object]:
    """Give a vendor's library with one instrument connected, simulated here on the served bench.

    Parameters
    ----------
    address
        The bench's.
    harp
        Says what instrument it is.

    Raises
    ------
    DeviceNotFoundError
        If no bench is served there.
    """
    from simulators.wire.harp import HarpSimulator
    from simulators.wire.served.timing import ServedBench

    with ExitStack() as stack:
        try:
            bench = stack.enter_context(ServedBench(address))
        except OSError as problem:
            raise _not_reached(f"served bench at {address}", problem) from problem
        faults = bench.faults
        simulator = HarpSimulator(
            bench, simulated_family(harp), timing=faults.timing, count_depth=faults.count_depth
        )
        try:
            yield simulator.functions
        finally:
            simulator.raise_pending()  # inside a C callback an exception is only an error code


@contextmanager
def board_at(address: str) -> Iterator[SharedBoard]:
    """Give the DAQ board of a served bench.

    Raises
    ------
    DeviceNotFoundError
        If no bench is served there.
    """
    from simulators.wire.served.board import ServedBoard

    with ExitStack() as stack:
        try:
            board = stack.enter_context(ServedBoard(address))
        except OSError as problem:
            raise _not_reached(f"served DAQ board at {address}", problem) from problem
        yield SharedBoard(board)


def _not_reached(what: str, problem: OSError) -> DeviceNotFoundError | LinkError:
    if problem.errno in (errno.EAGAIN, errno.EBUSY):
        return LinkError(what, "open the port", "another program uses it", "Close the other program.")
    remedy = "Start rig sim serve, and use the configuration that it writes."
    return DeviceNotFoundError(what, "answer", str(problem), remedy)
