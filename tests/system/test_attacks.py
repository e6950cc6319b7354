#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
# run: alone (it measures a victim beside attackers, who take all processors)
"""
Nineteen attacks, each beside a victim client that queries all the time. The victim must see no error, the
attackers must be cut off, memory must stay within its bound, and the counter that operators watch must rise.

The short form (half a second each, 4 attackers) runs in `make system`; `make attack` sets SECONDS and ATTACKERS
for the full one. Attackers live in processes of their own, and come back as soon as they are cut.
"""
import json
import os
import subprocess
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import h2_attacks  # noqa: E402
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
SECONDS = float(os.environ.get("SECONDS", "0.4"))
ATTACKERS = [int(word) for word in os.environ.get("ATTACKERS", "4").split(",")]
# The timers of the daemon, except the idle one. They are long enough for the victim, too, however
# busy the machine is.
TIMER_MS = 600 if SECONDS < 5 else 2000
GROWTH_FIXED = 64 << 20      # bytes resident, all attackers together
GROWTH_EACH = 256 << 10      # and for each of them
GROUP = 16                   # attackers in one process
test = ut.Test(limit_s=280 + 20 * SECONDS * len(ATTACKERS) * 2)
os.mkdir(test.path("store"))
test.bake(test.scene("city", 4), test.path("store", "city.umb"), "--resolution", 512, "--depth",
          "raster", "--verify", 0)
points = ut.floats(ut.random_points((-500, -10, -500), (500, 80, 500), 3000, 3))
M = test.messages.shadows
with open(test.path("body"), "wb") as file:
    file.write(h2.prefixed(M.QueryRequest(asset="city", points=points[:1200]).SerializeToString()))


class Victim:
    """Asks 200 times a second; counts errors."""

    def __init__(self, daemon):
        self.client = test.client(daemon.grpc_tcp, [("grpc.enable_retries", 0)])
        self.expected = self.client.ask("city", points[:1200]).visibility
        self.stopping = threading.Event()
        self.times, self.errors = [], []
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.stopping.wait(0.005):
            begin = time.monotonic()
            try:
                if self.client.ask("city", points[:1200], timeout=20).visibility != self.expected:
                    self.errors.append("another answer")
            except grpc.RpcError as error:
                self.errors.append(f"{error.code()}: {error.details()}")
            self.times.append(time.monotonic() - begin)

    def stop(self):
        self.stopping.set()
        self.thread.join()
        self.client.close()
        self.times.sort()

    def said(self):
        return (f"{len(self.times)} calls, p50 {self.times[len(self.times) // 2] * 1e3:.2f} ms, "
                f"p99 {self.times[len(self.times) * 99 // 100] * 1e3:.2f} ms")


def abuse(daemon):
    """Kind of abuse -> how often it was counted."""
    lines = [line for line in daemon.admin("/metrics")[1].splitlines() if line.startswith("umbrage_h2_abuse_total{")]
    return {line.split('"')[1]: float(line.rpartition(" ")[2]) for line in lines}


def under_attack(daemon, attack, count):
    """Runs one attack; returns the connections' (seconds, was cut) and the victim."""
    victim = Victim(daemon)
    seconds = max(SECONDS, 3 * TIMER_MS / 1000 if attack.slow else 0)
    program = os.path.join(os.path.dirname(h2_attacks.__file__), "h2_attacks.py")
    jobs = [subprocess.Popen([sys.executable, program, attack.name, str(daemon.port), str(min(GROUP, count - first)),
                              str(seconds), test.path("body")], stdout=subprocess.PIPE)
            for first in range(0, count, GROUP)]
    results = []
    for job in jobs:
        results += json.loads(job.communicate()[0])
    victim.stop()
    return results, victim


timers = [word for name in ("handshake", "body", "stall")
          for word in (f"--{name}-timeout", f"{TIMER_MS}ms")]
daemon = test.daemon("--max-connections", 1000, *timers)
quiet = Victim(daemon)
time.sleep(max(1, SECONDS / 4))
quiet.stop()
print(f"    the victim alone: {quiet.said()}")
for number in ATTACKERS:
    for attack in h2_attacks.ATTACKS:
        with test.check(f"{number} attackers: {attack.name}"):
            before = abuse(daemon)
            resident = daemon.resident_bytes()
            results, victim = under_attack(daemon, attack, number)
            growth = daemon.resident_bytes() - resident
            rose = [kind for kind, value in abuse(daemon).items() if value > before[kind]]
            cuts = sorted(seconds for seconds, was_cut in results if was_cut)
            print(f"    {len(cuts)} of {len(results)} connections cut"
                  + (f", half within {cuts[len(cuts) // 2]:.3f} s, all within {cuts[-1]:.2f} s" if cuts else "")
                  + f"; {', '.join(rose) or 'nothing'} counted; memory {growth / 2 ** 20:+.1f} MiB; victim: {victim.said()}")
            assert not victim.errors, victim.errors[:3]
            assert len(victim.times) > 3
            assert growth <= (GROWTH_FIXED + number * GROWTH_EACH) * (8 if ut.is_sanitized() else 1)
            if attack.cut:
                # The last connection of each attacker may just have begun when the time was over.
                assert len(cuts) >= len(results) - number and cuts, "attackers are not cut"
            if attack.counter:
                assert attack.counter in rose, f"{attack.counter} does not rise"
with test.check("the daemon answers on, and no connection is left"):
    ut.wait_until(lambda: daemon.metric("umbrage_connections") == 0, 10, "connections go")
    daemon.stop()
test.finish()
