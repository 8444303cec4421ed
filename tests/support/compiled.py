"""Compile what a scan and an image need, once: else each worker of the tests compiles it, all at once.

It works in the folder where it is started.
"""

import os
import sys

from rig.__main__ import main

if __name__ == "__main__":
    os.environ["RIG_STATE"] = os.getcwd()
    for words in ("scan --grid 4x3 --spacing 10cm --out a.h5", "recon a.h5 --depth 0.8m:1m:10cm"):
        sys.argv = ["rig", *words.split()]
        try:
            main()
        except SystemExit as ended:
            if ended.code:
                raise
