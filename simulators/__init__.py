"""The optical bench as physics, reached through the wire that the drivers use.

One `simulators.bench.Bench` holds the physical state and one clock. The simulated devices in
`simulators.wire` change it, or are driven by it, and by nothing else.
"""
