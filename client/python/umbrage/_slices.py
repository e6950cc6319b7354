# SPDX-License-Identifier: Apache-2.0
"""
Batches in slices: on one thread so that Ctrl-C is heard between them, on several so that they share the work.
"""
from __future__ import annotations

import itertools
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable, Optional

SLICE = 65536  # points: some milliseconds; a multiple of 512, so that no two slices share a cache line of answers

_pool: Optional[ThreadPoolExecutor] = None
_pool_threads = 0
_pool_lock = threading.Lock()


def _threads(count: int) -> Any:
    """A pool of at least `count` threads; it stays for later batches."""
    global _pool, _pool_threads
    with _pool_lock:
        if _pool_threads < count:
            if _pool is not None:
                _pool.shutdown(wait=False)
            _pool = ThreadPoolExecutor(count, "umbrage")
            _pool_threads = count
        return _pool


def run_slices(one: Callable[[int, int], Any], count: int, threads: int = 1, size: int = SLICE) -> None:
    """
    Calls one(first, number) for slices that cover 0 .. count - 1, on `threads` threads. An exception or an interrupt
    ends the batch after the slices that are under way.
    """
    if threads <= 1 or count <= size:
        for first in range(0, count, size):
            one(first, min(size, count - first))
        return
    numbers = itertools.count(0, size)  # next() of it is one step of the interpreter
    stop = threading.Event()

    def work() -> None:
        for first in numbers:
            if first >= count or stop.is_set():
                return
            one(first, min(size, count - first))

    pool = _threads(threads - 1)
    futures = [pool.submit(work) for _ in range(threads - 1)]
    try:
        work()
        for future in futures:
            future.result()
    except BaseException:
        stop.set()
        for future in futures:
            future.exception()
        raise
