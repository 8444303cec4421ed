"""A program whose timing instrument's library hangs: its first nine measurements return, the tenth never."""

#: Run it with ``python -c``; the arguments are those of ``rig``.
HANGING = """
import ctypes, sys, time
from rig.__main__ import main
from simulators.wire.harp import HarpSimulator

made = HarpSimulator.__init__


def hanging(self, *arguments, **options):
    made(self, *arguments, **options)
    usual, calls = self.functions.HH_StartMeas, []

    def start(index, duration_ms):  # the vendor's library returns nine times, and then never
        calls.append(index)
        if len(calls) > 9:
            time.sleep(1e6)
        return usual(index, duration_ms)

    self.functions.HH_StartMeas = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int)(start)


HarpSimulator.__init__ = hanging
sys.argv[0] = "rig"
main()
"""
