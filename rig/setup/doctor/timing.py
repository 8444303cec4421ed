"""The vendor's library of the timing instrument."""

from collections.abc import Iterator

from rig.model.config import HarpConfig, RigConfig
from rig.setup.doctor.devices import served
from rig.setup.doctor.finding import Finding


def check(config: RigConfig) -> Iterator[Finding]:
    """Return which library there is, its version and its place; nothing of a simulated rig."""
    if config.simulated:
        return
    from drivers.errors import DeviceError
    from drivers.harp.loading import load_library
    from rig.devices.kinds.harps import family_of

    if not isinstance(config.tcspc, HarpConfig):
        yield Finding("timing instrument", "ok", f"{config.tcspc.kind}: no instrument is needed")
        return
    if config.tcspc.address:
        yield served(f"served bench at {config.tcspc.address}", config.tcspc.address)
        return
    family = family_of(config.tcspc)
    what = f"{family.name} library"
    try:
        library = load_library(family, config.tcspc.library)
    except DeviceError as error:
        paste = f"export {family.files.variable}=/PATH/TO/{family.library}"
        yield Finding(what, "missing", error.answered, f"{error.remedy} {paste}")
    else:
        yield Finding(what, "ok", f"version {library.get_library_version()}, {library.name}")
