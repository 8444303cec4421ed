"""What tells one family of PicoQuant's timing instruments from another, as data.

One driver serves them all: their libraries have the same functions, but for a prefix and for what a `Family`
says. The families themselves are in `drivers.harp.families`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.harp.limits import HarpLimits
from drivers.harp.triggers import Trigger

#: USB vendor of all of these instruments.
PICOQUANT = 0x0E0D


@dataclass(frozen=True)
class LibraryFiles:
    """Where the vendor's library is on a computer.

    Attributes
    ----------
    variable
        Environment variable that names the file; where set, nothing else is tried.
    in_snapi
        Its name inside an installed ``snAPI`` package.
    linux, windows
        Names and paths to try.
    """

    variable: str
    in_snapi: str
    linux: tuple[str, ...]
    windows: str


@dataclass(frozen=True)
class Flags:
    """The bits of ``GetFlags``; 0 where a family has no such flag.

    Attributes
    ----------
    overflow, fifo_full, sync_lost, reference_lost, counts_dropped
        What spoils a measurement, see `told`.
    system_error, software_error
        After one of these the counts are worthless.
    active
        A measurement runs; says nothing of the counts.
    """

    overflow: int = 0x01
    fifo_full: int = 0x02
    sync_lost: int = 0x04
    reference_lost: int = 0x08
    system_error: int = 0x10
    active: int = 0x20
    counts_dropped: int = 0
    software_error: int = 0

    @property
    def errors(self) -> int:
        """Flags after which the counts are worthless."""
        return self.system_error | self.software_error

    def told(self, raised: int) -> list[tuple[int, str]]:
        """Return raised flags with what each says about a measurement; those nobody knows come as one."""
        sentences = {
            self.overflow: "A bin of the histogram is full: use a shorter exposure, attenuate, "
            "or move the gate.",
            self.fifo_full: "The instrument's buffer was full, so photons are missing: attenuate.",
            self.sync_lost: "The sync was lost, so photons are missing: check laser and sync cable.",
            self.reference_lost: (
                "The external reference clock was lost, so times may be wrong: check its source."
            ),
            self.counts_dropped: "More pulses came than it can process, so photons are missing: attenuate.",
        }
        told = [(bit, text) for bit, text in sentences.items() if raised & bit]
        if unknown := raised & ~(sum(sentences) | self.errors | self.active):
            text = (
                f"The instrument raised flags 0x{unknown:X}, which its library's documents do not explain: "
                "ask PicoQuant what they mean before you use the counts."
            )
            told.append((unknown, text))
        return told


@dataclass(frozen=True)
class Link:
    """What to do about the connection of computer and instrument, in words.

    Attributes
    ----------
    check
        What to look at first.
    restart
        How the instrument begins anew.
    absent
        Why it may not be found.
    """

    check: str
    restart: str
    absent: str


@dataclass(frozen=True)
class Family:
    """One family of instruments behind one library of the vendor.

    Attributes
    ----------
    name
        As it is called in messages.
    prefix, library, versions
        Of the functions; the library's name, and its releases that are known to fit.
    files, link
        Where the library is, and how the instrument is connected.
    devices
        So many indices there are.
    limits, trigger, bin_width_s
        What it can be set to; how its inputs trigger, and how wide bins are, where nobody says.
    errors, warnings, flags
        Names of the error codes without their prefix; what the bits of its warnings and flags mean.
    hardware, record_type
        How files of records call the instrument (UNCONFIRMED but for the HydraHarp 400), and the type of its
        T3 records in them.
    model
        The only model that is meant, as the instrument says it; empty where all are.
    fifo_records
        So many records one read can bring; the memory for them must be as large.
    fifo_step
        Reads are of multiples of this; 0 where a read is not told how many.
    debug
        The function that gives the instrument's own report.
    calibrates, takes_reference, clears_with_histogram
        Whether it has to be calibrated, whether Initialize takes a source of the reference clock, and whether
        GetHistogram takes an order to clear.
    """

    name: str
    prefix: str
    library: str
    versions: tuple[str, ...]
    files: LibraryFiles
    link: Link
    limits: HarpLimits
    trigger: Trigger
    bin_width_s: float
    errors: Mapping[int, str]
    warnings: Mapping[int, str]
    flags: Flags
    hardware: str
    record_type: int
    model: str = ""
    devices: int = 8
    fifo_records: int = 1 << 20
    fifo_step: int = 0
    debug: str = "GetDebugInfo"
    calibrates: bool = False
    takes_reference: bool = True
    clears_with_histogram: bool = False

    def error_name(self, code: int) -> str:
        """Return the vendor's name of an error code without its prefix, or ``UNKNOWN``."""
        return self.errors.get(code, "UNKNOWN")
