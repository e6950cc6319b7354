#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Overload and fairness of one daemon, measured with `umbrage load`: JSON lines, as the other benches.

    bench_overload.py [--seconds S]      the length of each measured part, default 5

Overload: the knee is found by a sweep; then twice that rate is asked beside a polite client, who came
before and stays after. Fairness: a greedy client keeps large batches under way, a polite one asks 64
points 100 times a second. The daemon has the first processor, generators the others. A part in which
a generator used more than 70 % of a core does not count and is told as such; the exit code is 1 if
a bar is missed by a part that counts.
"""
import argparse
import json
import os
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--seconds", type=float, default=5)
SECONDS = parser.parse_args().seconds
CPUS = sorted(os.sched_getaffinity(0))
LARGE = ("--batch", 2048, "--points", "random")  # so that the generator has little to do
POLITE = ("--rate", 100, "--connections", 1, "--points", "random")
missed = []


def start(*words):
    """A load test in the background."""
    command = [ut.program("umbrage"), "load", "city", "--json", "--quiet", "--address",
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


def overload(quiet):
    """Twice the knee's rate beside a polite client."""
    idle_bytes = daemon.resident_bytes()
    found = result(start("--sweep", "--rate", 200, "--duration", 1, "--bound", 50, *LARGE))
    knee = found["sweep"]["knee"]
    at_knee = result(start("--rate", knee, "--duration", SECONDS, *LARGE))
    # Noise can put the knee far below what the daemon can do; the flood must be one nevertheless.
    most = result(start("--duration", SECONDS, *LARGE))["calls_s"]
    flood_rate = 2 * max(knee, most)
    polite = start(*POLITE, "--warm-up", 0, "--duration", 2 + SECONDS + 4)
    begun = time.monotonic()
    time.sleep(2)
    flood = result(start("--rate", flood_rate, "--duration", SECONDS, "--warm-up", 0.5, "--admin",
                         daemon.addresses["http"], *LARGE))
    ended = time.monotonic() - begun
    beside = result(polite)
    counts = flood["counts"] and at_knee["counts"]
    row("goodput at twice the knee, of the knee's", flood["calls_s"] / at_knee["calls_s"], 0.9,
        "higher", counts, knee=knee, closed_loop=round(most), asked=round(flood_rate), calls_s=round(flood["calls_s"]), unsent=flood["unsent"],
        errors=flood["errors"], generator_cores=round(flood["generator_cores"], 2))
    row("memory at twice the knee, MiB more than before",
        (flood["server"]["rss_max_bytes"] - idle_bytes) / 2**20, 1024, "lower", counts)
    # Small pieces of ten calls each: back is when the median is what it was, give or take noise.
    limit = 3 * quiet["latency"]["p50_ms"] + 5
    late = [moment["at_s"] - ended for moment in beside["moments"]
            if moment["at_s"] > ended and moment["p50_ms"] > limit]
    row("seconds until latency is back", max(late, default=0.0), 2, "lower", counts,
        quiet_p50_ms=round(quiet["latency"]["p50_ms"], 3))


def fairness(quiet, *greedy):
    """p99 of a polite client beside a greedy one."""
    other = start("--connections", 1, "--in-flight", 8, "--batch", 65536, "--duration", SECONDS + 2,
                  "--points", "random", *greedy)
    time.sleep(1.2)
    polite = result(start(*POLITE, "--warm-up", 0.3, "--duration", SECONDS))
    full = result(other)
    bar = 3 * quiet["latency"]["p99_ms"] + 5
    row("p99 of a polite client beside a greedy one, ms", polite["latency"]["p99_ms"], round(bar, 2),
        "lower", polite["counts"] and full["counts"], greedy=" ".join(str(w) for w in greedy),
        quiet_p99_ms=round(quiet["latency"]["p99_ms"], 3),
        greedy_mpoints_s=round(full["points_s"] / 1e6, 2), errors=polite["error_count"])


test = ut.Test(limit_s=600)
os.mkdir(test.path("store"))
test.bake(test.scene("city", 14), test.path("store/city.umb"), "--resolution", 4096, "--verify", 0)
if len(CPUS) > 1:
    os.sched_setaffinity(0, CPUS[:1])
daemon = test.daemon("--workers", 1)
if len(CPUS) > 1:
    os.sched_setaffinity(0, CPUS[1:])
calm = result(start(*POLITE, "--duration", SECONDS))
overload(calm)
fairness(calm)
fairness(calm, "--connections", 4, "--taps", 9)
daemon.stop()
raise SystemExit(1 if missed else 0)
