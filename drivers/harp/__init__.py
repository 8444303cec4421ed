"""PicoQuant HydraHarp 400 through the vendor's library HHLib 3.0.

    from drivers.harp.device import HydraHarp
    from drivers.harp.loading import load_library
    from drivers.harp.settings import HydraHarpSettings

    with HydraHarp(load_library(), clock=SystemClock(), settings=HydraHarpSettings(inputs=(0, 1))) as tcspc:
        exposure = tcspc.measure(10e-3)

Photons one by one: `drivers.harp.stream`.

`drivers.harp.limits` and `drivers.harp.settings` can be imported where neither instrument, library
nor numpy is at hand; therefore nothing is imported here.
"""
