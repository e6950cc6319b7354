#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
python_turns.py ASSET POINTS THREADS: the Python side of bench_python.py. Answers the raw floats of the file POINTS in one
call on THREADS threads, once for each line of stdin, and prints the seconds by the clock and of processors.
"""
import sys
import time

import numpy as np
import umbrage

points = np.fromfile(sys.argv[2], np.float32).reshape(-1, 3)
values = np.zeros(len(points), np.float32)
with umbrage.open(sys.argv[1]) as asset:
    for _ in sys.stdin:
        begin, busy = time.perf_counter(), time.process_time()
        asset.query(points, taps=9, threads=int(sys.argv[3]), out=values)
        print(time.perf_counter() - begin, time.process_time() - busy, flush=True)
