"""PicoQuant's timing instruments through the vendor's libraries: HydraHarp, MultiHarp, PicoHarp, TimeHarp.

    from drivers.harp.device import Harp
    from drivers.harp.families import MULTIHARP
    from drivers.harp.loading import load_library
    from drivers.harp.settings import HarpSettings

    settings = HarpSettings(family=MULTIHARP, inputs=(0, 1))
    with Harp(load_library(MULTIHARP), clock=SystemClock(), settings=settings) as tcspc:
        exposure = tcspc.measure(10e-3)

Photons one by one: `drivers.harp.stream`. What tells the families apart is data: `drivers.harp.families`.

`drivers.harp.limits`, `drivers.harp.families` and `drivers.harp.settings` can be imported where neither
instrument, library nor numpy is at hand; therefore nothing is imported here.
"""
