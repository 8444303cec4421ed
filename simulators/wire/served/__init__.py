"""The simulated devices of one bench for other programs: a process of its own serves them, POSIX only.

Galvo, laser and detector are pseudo-terminals, which any program opens as it opens a serial port. The
detector's carries what passes over USB, see `detector`. The timing instrument is simulated by the program
that measures; it asks the served bench for detections over a local socket, see `timing`.
"""

#: What reading a request raises that is none, or asks for what cannot be.
NO_REQUEST = (ValueError, LookupError, TypeError, OverflowError, RecursionError)
