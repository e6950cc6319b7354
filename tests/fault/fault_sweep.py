# SPDX-License-Identifier: Apache-2.0
"""
Shared by the fault tests: a run with one fault (inject.c), and the choice of the calls that fail.

    sweep = fault_sweep.Sweep(test)
    end = sweep.run(["umbrage", "info", path], calls="memory", action="ENOMEM", at=7)
    for at in sweep.points(end.calls): ...

With FAULT=short few calls are chosen, otherwise at most LIMIT of a kind: all of the first calls,
then every k-th. The chosen calls are printed.
"""
import contextlib
import os
import signal
import struct
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

SHORT = os.environ.get("FAULT") == "short"
LIMIT = 16 if SHORT else 400
HANG_S = 20            # no program here takes a tenth of it
KEEP = (1 << 64) - 1   # last call to fail: none is the last
KILLED = -signal.SIGKILL


class End:
    """How a run ended."""

    def __init__(self, code, out, err, calls, faults, trace):
        self.code, self.out, self.err = code, out, err
        self.calls, self.faults = calls, faults
        self.trace = trace  # [(function, ok, path)] of the counted file calls

    def __str__(self):
        return f"exit code {self.code}, {self.faults} faults, stderr: {self.err[-500:]!r}"

    def died(self):
        """True if a signal or a failed check inside a library ended it."""
        return self.code < 0 or self.code >= 126


class Board:
    """The counters that inject.so shares with us; see struct board."""

    def __init__(self, path):
        self.path = path
        with open(path, "wb") as file:
            file.write(bytes(4096))

    def read(self, index):
        with open(self.path, "rb") as file:
            file.seek(8 * index)
            return struct.unpack("<Q" if sys.byteorder == "little" else ">Q", file.read(8))[0]

    def write(self, index, value):
        with open(self.path, "r+b", buffering=0) as file:
            file.seek(8 * index)
            file.write(value.to_bytes(8, sys.byteorder))

    @property
    def calls(self):
        return self.read(2)

    @property
    def faults(self):
        return self.read(3)

    def fail(self, first, last):
        """Calls first..last fail from now on; (0, 0): none."""
        self.write(0, 0)
        self.write(1, last)
        self.write(0, first)


class Sweep:
    def __init__(self, test):
        self.test = test
        self.library = ut.program("inject.so")
        self.runs = 0
        self.boards = 0
        if ut.is_sanitized():
            ut.skip("a sanitizer's allocator cannot be preloaded over; use config=debug or release")

    def environment(self, board, calls, action, at=0, keep=False, under=None, trace=None):
        values = {"LD_PRELOAD": self.library, "UMBRAGE_FAULT_CALLS": calls,
                  "UMBRAGE_FAULT_ACTION": action, "UMBRAGE_FAULT_AT": str(at),
                  "UMBRAGE_FAULT_KEEP": "1" if keep else "0",
                  "UMBRAGE_FAULT_BOARD": board.path}
        if under:
            values["UMBRAGE_FAULT_UNDER"] = under
        if trace:
            values["UMBRAGE_FAULT_TRACE"] = trace
        return values

    @contextlib.contextmanager
    def injected(self, *args, **named):
        """For daemons: programs that start inside the `with` block get the fault. Gives the
        counters shared with them."""
        self.boards += 1  # a daemon keeps its own for as long as it lives
        board = Board(self.test.path(f"board{self.boards}"))
        values = self.environment(board, *args, **named)
        os.environ.update(values)
        try:
            yield board
        finally:
            for name in values:
                del os.environ[name]

    def run(self, words, calls, action, at=0, keep=False, under=None, stdin=None, env=None):
        """Runs a program of the build with one fault; a hang is an error here and now."""
        self.runs += 1
        board = Board(self.test.path("board"))
        trace_path = self.test.path("trace")
        forget_trace(trace_path)
        command = [ut.program(words[0])] + [str(word) for word in words[1:]]
        if words[0] == "umbrage-bake":  # inject.so opens board and trace, where no bake may
            command += ["--sandbox", "off"]
        values = self.environment(board, calls, action, at, keep, under, trace_path)
        try:
            done = subprocess.run(command, input=stdin if stdin is not None else b"",
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=HANG_S,
                                  env={**os.environ, **(env or {}), **values}, check=False)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"{command} hangs with call {at} failing") from error
        return End(done.returncode, done.stdout, done.stderr, board.calls, board.faults,
                   read_trace(trace_path))

    def points(self, count, limit=LIMIT):
        """Numbers of the calls to fail out of 1..count: all, or the first ones and every k-th."""
        if count <= limit:
            return list(range(1, count + 1))
        first = limit // 4
        left = limit - first
        step = -(-(count - first) // left)
        return list(range(1, first + 1)) + list(range(first + 1, count + 1, step))


def forget_trace(path):
    with contextlib.suppress(FileNotFoundError):
        os.remove(path)


def read_trace(path):
    calls = []
    with contextlib.suppress(FileNotFoundError):
        with open(path, encoding="utf-8") as file:
            for line in file.read().splitlines():
                _, _, function, how, name = line.split(" ", 4)
                calls.append((function, how == "ok", name))
    return calls


def failed_fsyncs_are_final(trace):
    """After a failed fsync the kernel may have dropped the pages: a file must not be synced a
    second time or renamed. A folder may be synced again only for another file that was renamed in
    it since."""
    bad = set()
    for function, worked, path in trace:
        assert not (path in bad and function in ("fsync", "fdatasync", "rename")), \
            f"{function} of {path} after its fsync failed"
        if function in ("fsync", "fdatasync") and not worked:
            bad.add(path)
        elif function == "rename" and worked:
            bad.discard(os.path.dirname(path))


def one_sentence(err, program):
    """The program's last line on stderr, which must be the only one and name the program."""
    lines = err.decode(errors="replace").splitlines()
    assert len(lines) == 1 and lines[0].startswith(program + ": ") and len(lines[0]) > len(
        program) + 10, f"not one sentence: {lines}"
    return lines[0]


class Failures:
    """Collects what went wrong in a sweep, so that one bad point does not hide the others."""

    def __init__(self):
        self.list = []
        self.done = 0

    @contextlib.contextmanager
    def point(self, *what):
        self.done += 1
        try:
            yield
        except AssertionError as error:
            self.list.append(" ".join(str(word) for word in what) + f": {error}")

    def end(self):
        assert self.done > 0, "nothing was swept"
        for line in self.list[:20]:
            print("   ", line)
        assert not self.list, f"{len(self.list)} of {self.done} points"
