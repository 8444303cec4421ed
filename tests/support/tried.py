"""What a library may do with a file, for trials: a module of its own, so that a new process loads little."""

import os
import time
from contextlib import suppress


def die(path):
    os.abort()


def swallow(path):
    return len(bytearray(2**40))


def turn(path):
    while True:
        pass


def stay(path):
    """Compute nothing, for ever; who runs it is noted in the file."""
    with open(path, "w") as file:
        file.write(str(os.getpid()))
    while True:
        time.sleep(60)


def nest(path):
    """Answer with what no reader of JSON can take, in place of the answer that was asked for."""
    pipe = max(int(number) for number in os.listdir("/proc/self/fd") if _is_pipe(number))
    text = b"[" * 200_000
    while text:
        text = text[os.write(pipe, text) :]
    os._exit(0)


def _is_pipe(number):
    try:
        return os.readlink(f"/proc/self/fd/{number}").startswith("pipe")
    except OSError:
        return False


def connections(path):
    """Return how many sockets a file could speak over."""
    found = 0
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            found += os.readlink(f"/proc/self/fd/{number}").startswith("socket")
    return found


def size(path):
    return os.path.getsize(path)
