# SPDX-License-Identifier: Apache-2.0
"""
Divides batches into slices. On one thread, Python handles Ctrl-C between two slices; several
threads share the slices.
"""
from __future__ import annotations

import os
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Callable, Optional

SLICE = 65536        # points: a millisecond; a multiple of 512, so that no two slices share a cache line of answers
LONG_SLICE = 262144  # points of a slice of a large batch: the interpreter takes some microseconds a slice

_pool: Optional[ThreadPoolExecutor] = None
_pool_threads = 0
_pool_lock = threading.Lock()


def _threads(count: int) -> Any:
    """A pool of at least `count` threads; it stays for later batches."""
    global _pool, _pool_threads
    with _pool_lock:
        if _pool_threads < count:
            _pool = ThreadPoolExecutor(count, "umbrage")  # the threads of a smaller one end with their last batch
            _pool_threads = count
        return _pool


def _forget() -> None:
    """A child after fork has none of the threads."""
    global _pool, _pool_threads, _pool_lock
    _pool, _pool_threads, _pool_lock = None, 0, threading.Lock()


os.register_at_fork(after_in_child=_forget)


def _end(futures: list[Future[None]]) -> None:
    """Waits for what is under way, also when interrupted once more: a slice takes milliseconds."""
    for future in futures:
        while not future.cancel() and not future.done():
            try:
                future.exception()
            except BaseException:
                pass


def _cut(count: int, threads: int, size: int, longest: int) -> list[tuple[int, int]]:
    """First item and number of each slice. The last 8 for each thread have `size` items, so that the threads end
    together."""
    slices, first = [], 0
    while first < count:
        left = count - first
        number = min(left, longest if left > 8 * threads * size else size)
        slices.append((first, number))
        first += number
    return slices


def run_slices(one: Callable[[int, int], Any], count: int, threads: int = 1, size: int = SLICE,
               longest: int = 0) -> None:
    """
    Calls one(first, number) for slices that cover 0 .. count - 1, on `threads` threads. A slice has `size` items, and
    in a large batch `longest`. An exception or an interrupt ends the batch after the slices that are under way.
    """
    slices = _cut(count, threads, size, longest or size)
    if threads <= 1 or len(slices) <= 1:
        for first, number in slices:
            one(first, number)
        return
    shared = iter(slices)  # next() of it is one step of the interpreter
    stop = threading.Event()

    def work() -> None:
        for first, number in shared:
            if stop.is_set():
                return
            one(first, number)

    pool, futures = _threads(threads - 1), []
    try:
        for _ in range(threads - 1):
            futures.append(pool.submit(work))
        work()
        for future in futures:
            if not future.cancel():  # it has begun
                future.result()
    except BaseException:
        stop.set()
        _end(futures)
        raise


def aside(call: Callable[[], Any]) -> Any:
    """Calls a function that blocks in C on a thread of its own, so that Ctrl-C is heard meanwhile."""
    future: Future[Any] = Future()

    def run() -> None:
        try:
            future.set_result(call())
        except BaseException as problem:
            future.set_exception(problem)

    threading.Thread(target=run, daemon=True).start()
    return future.result()
