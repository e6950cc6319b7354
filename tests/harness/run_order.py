# SPDX-License-Identifier: Apache-2.0
"""
Which test runs when. The table of times has a line "SECONDS PROCESSOR_SECONDS NAME" for each test
that takes a second or more. From it come the order (longest first) and the number of processors
that a test keeps busy: tests that wait run beside tests that compute.
"""
import os
import threading

TABLE = os.environ.get("TEST_TIMES") or os.path.join(os.path.dirname(os.path.abspath(__file__)), "times.txt")
SHORTEST = 1.0         # second: tests that take less have no line
NEW = (1.0, 1.0)       # what a test without a line takes
MOST_AT_ONCE = 4       # tests a processor
LEAST_SHARE = 0.1      # processors
WAITING_SHARE = 0.5    # processors: at most so much has a test that may overtake a larger one
OVERLAP = 0.6          # processors above those that there are


def name_of(test):
    """A test's name in the table: the same for all builds and folders."""
    return os.path.basename(test)


def read():
    """{name: (seconds, processor seconds)}"""
    times = {}
    try:
        with open(TABLE, encoding="utf-8") as file:
            for line in file:
                seconds, busy, name = line.split()
                times[name] = (float(seconds), float(busy))
    except OSError:
        pass  # without the table all tests are new
    return times


def write(measured):
    """Replaces the lines of the measured tests; the others stay."""
    times = {name: pair for name, pair in {**read(), **measured}.items() if max(pair) >= SHORTEST}
    with open(TABLE, "w", encoding="utf-8") as file:
        for name in sorted(times):
            file.write("%.1f %.1f %s\n" % (*times[name], name))


class Room:
    """Starts tests in threads while processors are free."""

    def __init__(self, processors, seconds_of):
        self.processors = processors
        self.seconds_of = seconds_of  # of a test: (seconds, processor seconds)
        self.busy, self.running = 0.0, 0
        self.change = threading.Condition()

    def share(self, test):
        """Processors that the test keeps busy."""
        seconds, busy = self.seconds_of(test)
        most = max(1.0, 0.75 * self.processors)
        return min(max(busy / max(seconds, 0.1), LEAST_SHARE), most)

    def fits(self, test):
        if self.running == 0:
            return True
        if self.processors == 1 or self.running >= MOST_AT_ONCE * self.processors:
            return False
        return self.busy + self.share(test) <= self.processors + OVERLAP

    def choose(self, waiting):
        """Returns the first test; while that does not fit, the first that mostly waits and fits."""
        for place, test in enumerate(waiting):
            if self.fits(test) and (place == 0 or self.share(test) <= WAITING_SHARE):
                return waiting.pop(place)
        return None

    def run(self, tests, one):
        """Calls one(test) for every test, longest first, and waits for all."""
        waiting = sorted(tests, key=lambda test: -max(self.seconds_of(test)))
        threads = []
        while waiting:
            with self.change:
                test = self.choose(waiting)
                if test is None:
                    self.change.wait()
                    continue
                self.busy, self.running = self.busy + self.share(test), self.running + 1
            threads.append(threading.Thread(target=self.enter, args=(test, one)))
            threads[-1].start()
        for thread in threads:
            thread.join()

    def enter(self, test, one):
        try:
            one(test)
        finally:
            with self.change:
                self.busy, self.running = self.busy - self.share(test), self.running - 1
                self.change.notify()
