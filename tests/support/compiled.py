"""Compile what a scan and an image need, once: else each worker of the tests compiles it, all at once."""

import os
import sys
import tempfile

from rig.__main__ import main

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        os.environ["RIG_STATE"] = folder
        for words in ("scan --grid 4x3 --spacing 10cm --out a.h5", "recon a.h5 --depth 0.8m:1m:10cm"):
            sys.argv = ["rig", *words.split()]
            try:
                main()
            except SystemExit as ended:
                if ended.code:
                    raise
