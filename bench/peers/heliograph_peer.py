#!/usr/bin/env python3
"""Heliograph on a neutral scene, through its Python client. Run by measure.py."""

import functools
import os
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import heliograph as hg
import usage

THREADS = "2"

if __name__ == "__main__":
    tree = usage.Tree()
    started = time.perf_counter(), tree.usage()[0]
    client = hg.connect(arguments=["--threads", THREADS])  # first: it starts while Python imports
    import common
    from heliograph_scene import Heliograph

    common.main(functools.partial(Heliograph, client), usage=tree.usage, started=started)
