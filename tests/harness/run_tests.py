#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
run_tests.py TEST...: runs each test in a process group of its own under a timeout, as many side by
side as keep the processors busy (run_order.py), and prints one line a test, the output of those
that fail, the ten slowest, and at the end one line "N passed, N failed, N skipped".

A test is skipped by exit code 77. A part that a passing test leaves out counts as skipped too: the
test prints a line "SKIPPED: name: reason" (cmocka's "[  SKIPPED ] name" counts as well), and that
line is shown below the test.

A test whose source holds a line "# run: alone (reason)" (in C "/* run: alone (reason) */") measures
time or fills the machine: it runs by itself, after the others.

  TEST_JOBS=N       processors to keep busy (default: all); 1: one test after the other
  TEST_TIMEOUT=S    seconds that a test may take (default 600)
  TEST_ATTEMPTS=2   a failed test runs once more, by itself, at the end, unless a sanitizer spoke.
                    A pass then is UNSTEADY: a bug in the test or in what it tests.
  TEST_UNSTEADY=fail, or CI=true   an UNSTEADY test counts as failed
  TEST_TIMES=FILE   the table of times (default tests/harness/times.txt)
  TEST_RECORD=1     writes the times of this run into the table (measure with TEST_JOBS=1)
"""
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time

import run_order

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
ALONE = re.compile(r"^(# |/\* )run: alone \(.+\)", re.MULTILINE)
SKIPPED = re.compile(r"^(?:SKIPPED: (.*)|\[  SKIPPED \] (?!\d+ test)(.*))$", re.MULTILINE)
SANITIZER = re.compile(r"Sanitizer|runtime error:")
JOBS = int(os.environ.get("TEST_JOBS") or os.cpu_count() or 1)
TIMEOUT_S = float(os.environ.get("TEST_TIMEOUT") or 600)
ATTEMPTS = int(os.environ.get("TEST_ATTEMPTS") or 1)
STRICT = os.environ.get("TEST_UNSTEADY") == "fail" or os.environ.get("CI") == "true"
SHOWN_LINES = 60
SHOWN_SLOWEST = 10
SKIP = 77
TIMED_OUT = 124

groups = set()  # process groups of running tests
lock = threading.Lock()  # of groups and of stdout
ended = threading.Event()  # set by an interrupt: no further test begins


class Run:
    """One run of one test: exit code, output, seconds, seconds of processors."""

    def __init__(self, test):
        begin = time.monotonic()
        with tempfile.TemporaryFile() as log:
            self.code, self.busy = run_in_group(test, log)
            log.seek(0)
            self.output = log.read().decode(errors="replace")
        self.seconds = time.monotonic() - begin
        self.inner = [one or other for one, other in SKIPPED.findall(self.output)]

    def failed(self):
        return self.code not in (0, SKIP)

    def last_line(self):
        lines = self.output.strip().splitlines()
        return lines[-1] if lines else "no reason given"

    def tail(self, prefix):
        return "".join(f"{prefix}{line}\n" for line in self.output.splitlines()[-SHOWN_LINES:])


def kill_group(group, how):
    try:
        os.killpg(group, how)
    except ProcessLookupError:
        pass


def run_in_group(test, log):
    """
    Returns the exit code of the test, or TIMED_OUT, and the processor seconds of its processes.
    Processes that are left in its group are killed.
    """
    try:
        process = subprocess.Popen([test], stdin=subprocess.DEVNULL, stdout=log,
                                   stderr=subprocess.STDOUT, start_new_session=True)
    except OSError as error:
        log.write(f"{error}\n".encode())
        return 126, 0.0
    late = []
    alarms = [threading.Timer(TIMEOUT_S, lambda: late.append(kill_group(process.pid, signal.SIGTERM))),
              threading.Timer(TIMEOUT_S + 10, kill_group, (process.pid, signal.SIGKILL))]
    with lock:
        groups.add(process.pid)
    for alarm in alarms:  # between the two the test may still stop its daemons
        alarm.start()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    for alarm in alarms:
        alarm.cancel()
    with lock:
        groups.discard(process.pid)
    kill_group(process.pid, signal.SIGKILL)
    if late:
        log.write(f"\nrun_tests.py: ended after {TIMEOUT_S:g} s\n".encode())
        return TIMED_OUT, 0.0
    code = process.returncode
    return code if code >= 0 else 128 - code, usage.ru_utime + usage.ru_stime


def source_of(test):
    """The text that may hold the "alone" mark: a script itself, or the C source of a built
    test."""
    if test.endswith((".py", ".sh")):
        return test
    build = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
    return os.path.join(ROOT, os.path.relpath(os.path.abspath(test), build) + ".c")


def is_alone(test):
    try:
        with open(source_of(test), encoding="utf-8") as file:
            return ALONE.search(file.read()) is not None
    except OSError:
        return False


class Tally:
    """Verdicts of all tests; prints each as it comes."""

    def __init__(self):
        self.passed, self.failed, self.skipped, self.unsteady = 0, 0, 0, 0
        self.runs = {}  # of each test, the last

    def note(self, test, run, first=None):
        self.runs[test] = run
        if run.failed():
            verdict, self.failed = f"FAILED (exit {run.code})", self.failed + 1
        elif run.code == SKIP:
            verdict, self.skipped = run.last_line(), self.skipped + 1
            verdict = "skipped: " + re.sub(r"^(skipped|SKIPPED): ", "", verdict)
        else:
            verdict = self.note_passed(first)
            self.skipped += len(run.inner)
        print(f"{test:<60} {verdict} ({run.seconds:.0f} s)")
        if run.code == 0:
            print("".join(f"    skipped in it: {line}\n" for line in run.inner), end="")
        if first is not None:
            print(first.tail("    first: "), end="")
        if run.failed():
            print(run.tail("    "), end="")
        sys.stdout.flush()

    def note_passed(self, first):
        if first is None:
            self.passed += 1
            return "ok"
        self.unsteady += 1
        if STRICT:
            self.failed += 1
            return f"FAILED, UNSTEADY: first exit {first.code}, then ok"
        self.passed += 1
        return f"ok, UNSTEADY: first exit {first.code}"

    def slowest(self):
        runs = sorted(self.runs.items(), key=lambda pair: -pair[1].seconds)
        text = (f"{os.path.splitext(os.path.basename(test))[0]} {run.seconds:.0f}/{run.busy:.0f}"
                for test, run in runs[:SHOWN_SLOWEST])
        total = sum(run.busy for run in self.runs.values())
        print(f"slowest (seconds/of processors; all together {total:.0f}): " + ", ".join(text))

    def finish(self):
        if len(self.runs) > SHOWN_SLOWEST:
            self.slowest()
        if self.unsteady:
            print(f"{self.unsteady} of the {'failed' if STRICT else 'passed'} were UNSTEADY")
        print(f"{self.passed} passed, {self.failed} failed, {self.skipped} skipped")
        return 0 if self.failed == 0 else 1


def run_all(tests, tally):
    again = []

    def one(test):
        if ended.is_set():
            return
        run = Run(test)
        with lock:
            if run.failed() and ATTEMPTS > 1 and not SANITIZER.search(run.output):
                again.append((test, run))
            else:
                tally.note(test, run)

    alone = [test for test in tests if is_alone(test)]
    times = run_order.read()
    room = run_order.Room(JOBS, lambda test: times.get(run_order.name_of(test), run_order.NEW))
    room.run([test for test in tests if test not in alone], one)
    for test in alone:
        one(test)
    for test, first in again:
        tally.note(test, Run(test), first)


def stop(number, _frame):
    """An interrupt of the runner must end the tests, too, since they have sessions of their own."""
    ended.set()
    for group in list(groups):
        kill_group(group, signal.SIGTERM)
    os.write(1, f"ended by {signal.Signals(number).name}\n".encode())
    os._exit(128 + number)


def main():
    supp = os.path.join(os.path.dirname(os.path.abspath(__file__)), "tsan.supp")
    os.environ["TSAN_OPTIONS"] = f"suppressions={supp} {os.environ.get('TSAN_OPTIONS', '')}"
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)  # a shell ignores it for its background jobs
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    tally = Tally()
    run_all(sys.argv[1:], tally)
    if os.environ.get("TEST_RECORD"):
        run_order.write({run_order.name_of(test): (run.seconds, run.busy)
                             for test, run in tally.runs.items() if run.code == 0})
    return tally.finish()


if __name__ == "__main__":
    sys.exit(main())
