#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Overload and fairness of one daemon, measured with `umbrage load`: JSON lines, as the other benches.

    bench_overload.py [--seconds S]      the length of each measured part, default 5

Overload: a sweep finds the knee. Then clients send twice that rate beside a polite client, which was
connected before and stays afterwards. Fairness: a greedy client keeps large batches under way, a
polite one queries 64 points 100 times a second, as a real-time process where that is allowed (root).
The daemon has the first processor, generators the others. A part in which
a generator used more than 70 % of a core does not count, and is marked so in the output. The exit
code is 1 if a part that counts misses its bar.
"""
import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--seconds", type=float, default=5)
SECONDS = parser.parse_args().seconds
CPUS = sorted(os.sched_getaffinity(0))
LARGE = ("--batch", 2048, "--taps", 9, "--points", "random")  # the generator has little to do
POLITE = ("--rate", 100, "--connections", 1, "--points", "random")
# The polite client shares its processor with the greedy one. Without real-time priority it would
# measure the greedy client's turns.
PROMPT = ["chrt", "--fifo", "50"]
if not shutil.which("chrt") or subprocess.run([*PROMPT, "true"], stderr=subprocess.DEVNULL).returncode:
    PROMPT = []
ROUNDS = 3
missed = []


def start(*words, first=()):
    """A load test in the background; `first`: the command that starts it."""
    command = [*first, ut.program("umbrage"), "load", "city", "--json", "--quiet", "--address",
               "unix:" + daemon.socket_path, *[str(word) for word in words]]
    return subprocess.Popen(command, stdout=subprocess.PIPE)


def result(process):
    out, _ = process.communicate(timeout=600)
    if process.returncode != 0:
        raise SystemExit(f"umbrage load: exit code {process.returncode}")
    return json.loads(out)


def row(metric, value, bar, better, counts, **more):
    """One figure; better: "higher" or "lower" than the bar."""
    kept = value >= bar if better == "higher" else value <= bar
    print(json.dumps({"bench": "overload", "metric": metric, "value": round(value, 4), "bar": bar,
                      "better": better, "kept": kept, "counts": counts, **more}), flush=True)
    if counts and not kept:
        missed.append(metric)


def flood_once(knee, rate):
    """At the knee; then `rate` beside a polite client: results, and when the flood ended for it."""
    at_knee = result(start("--rate", knee, "--duration", SECONDS, *LARGE))
    polite = start(*POLITE, "--warm-up", 0, "--duration", 2 + SECONDS + 4, first=PROMPT)
    begun = time.monotonic()
    time.sleep(2)
    # 16 connections, 4096 calls under way: more than the daemon's queue takes.
    flood = result(start("--rate", rate, "--connections", 16, "--duration", SECONDS, "--warm-up",
                         0.5, "--admin", daemon.addresses["http"], *LARGE))
    ended = time.monotonic() - begun
    return at_knee, flood, result(polite), ended


def overload(quiet):
    """Twice the knee's rate beside a polite client. The median of ROUNDS runs counts, because other
    programs use the machine."""
    idle_bytes = daemon.resident_bytes()
    found = result(start("--sweep", "--rate", 200, "--duration", 1, "--bound", 50, *LARGE))
    knee = found["sweep"]["knee"]
    # Noise can put the knee far below the daemon's capacity, but the flood must exceed that
    # capacity.
    most = result(start("--duration", SECONDS, *LARGE))["calls_s"]
    rate = 2 * max(knee, most)
    rounds = [flood_once(knee, rate) for _ in range(ROUNDS)]
    daemon_cores = [four[1]["server"]["cpu_s"] / SECONDS for four in rounds]
    # A daemon that did not use its whole processor was not flooded: other programs had the rest.
    counts = (all(part["counts"] for four in rounds for part in four[:2])
              and min(daemon_cores) >= 0.85)
    row("goodput at twice the knee, of the knee's",
        statistics.median(flood["calls_s"] / at_knee["calls_s"] for at_knee, flood, _, _ in rounds),
        0.9, "higher", counts, knee=knee, closed_loop=round(most), asked=round(rate),
        at_knee=[round(four[0]["calls_s"]) for four in rounds],
        calls_s=[round(four[1]["calls_s"]) for four in rounds],
        errors=[four[1]["errors"] for four in rounds],
        generator_cores=[round(four[1]["generator_cores"], 2) for four in rounds],
        daemon_cores=[round(cores, 2) for cores in daemon_cores])
    most_bytes = max(four[1]["server"]["rss_max_bytes"] for four in rounds)
    row("memory at twice the knee, MiB more than before", (most_bytes - idle_bytes) / 2**20, 1024,
        "lower", counts)
    # Small pieces of ten calls each. The client has recovered when the median is the old one, give
    # or take noise.
    limit = 3 * quiet["latency"]["p50_ms"] + 5
    late = [max((moment["at_s"] - ended for moment in beside["moments"]
                 if moment["at_s"] > ended and moment["p50_ms"] > limit), default=0.0)
            for _, _, beside, ended in rounds]
    row("seconds until latency is back", statistics.median(late), 2, "lower", counts, late_s=late,
        quiet_p50_ms=round(quiet["latency"]["p50_ms"], 3))


def fairness_once(*greedy):
    """A polite client alone, then beside a greedy one: three results."""
    quiet = result(start(*POLITE, "--warm-up", 0.3, "--duration", SECONDS, first=PROMPT))
    other = start("--connections", 1, "--in-flight", 8, "--batch", 65536, "--duration", SECONDS + 2,
                  "--points", "random", *greedy)
    time.sleep(1.2)
    beside = result(start(*POLITE, "--warm-up", 0.3, "--duration", SECONDS, first=PROMPT))
    return quiet, beside, result(other)


def fairness(*greedy):
    """p99 of a polite client beside a greedy one, the median of ROUNDS runs, because other programs
    use the machine."""
    rounds = [fairness_once(*greedy) for _ in range(ROUNDS)]
    quiet, beside = ([part[k]["latency"]["p99_ms"] for part in rounds] for k in range(2))
    bar = 3 * statistics.median(quiet) + 5
    row("p99 of a polite client beside a greedy one, ms", statistics.median(beside), round(bar, 2),
        "lower", all(part["counts"] for three in rounds for part in three),
        greedy=" ".join(str(word) for word in greedy), quiet_p99_ms=quiet, p99_ms=beside,
        greedy_mpoints_s=round(max(part[2]["points_s"] for part in rounds) / 1e6, 2),
        real_time=bool(PROMPT), errors=sum(part[1]["error_count"] for part in rounds))


test = ut.Test(limit_s=600)
os.mkdir(test.path("store"))
test.bake(test.scene("city", 14), test.path("store/city.umb"), "--resolution", 4096, "--verify", 0)
if len(CPUS) > 1:
    os.sched_setaffinity(0, CPUS[:1])
daemon = test.daemon("--workers", 1)
if len(CPUS) > 1:
    os.sched_setaffinity(0, CPUS[1:])
calm = result(start(*POLITE, "--duration", SECONDS, first=PROMPT))
overload(calm)
fairness()
fairness("--connections", 4, "--taps", 9)
daemon.stop()
raise SystemExit(1 if missed else 0)
