#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Instructions that umbraged executes for one small Query, from the socket to the reply, counted by
callgrind. The libraries' instructions (libuv, nghttp2) count, the kernel's do not. Calls that warm
the daemon up, its start and its calibration are left out. A pause before each call gives its
connection a new turn of the loop: under callgrind a call is slow enough to use a turn up, and the
next one would go to the workers.

query_instructions.py [FOLDER...]: build folders; the first is compared with the others.
`make query-instructions BEFORE=FOLDER`.
"""
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

WARM, CALLS, ROUNDS, PAUSE_S = 200, 500, 3, 0.003
BATCHES = ((1, 1), (64, 1), (64, 9))  # points of a call, taps


def ask(client, request, times):
    """Calls one after another."""
    for _ in range(times):
        time.sleep(PAUSE_S)
        client.query(request, timeout=60)


def dump(folder, daemon):
    """Instructions since the last dump of a daemon under callgrind."""
    before = set(os.listdir(folder))
    subprocess.run(["callgrind_control", "--dump", str(daemon.pid)], check=True, capture_output=True)
    ut.wait_until(lambda: set(os.listdir(folder)) - before, 60, "callgrind writes")
    path = os.path.join(folder, (set(os.listdir(folder)) - before).pop())

    def total():
        with open(path, encoding="utf-8") as file:
            return re.search(r"^totals: (\d+)", file.read(), re.M)
    ut.wait_until(total, 60, "callgrind has written")
    return int(total().group(1))


def counted(folder, test, store, points, taps):
    """Instructions a call of the daemon of a build folder, the median of ROUNDS."""
    dumps = tempfile.mkdtemp(dir=test.path())
    address = dumps + ".address"
    with open(dumps + ".log", "wb") as log:
        daemon = subprocess.Popen(
            ["valgrind", "--tool=callgrind", f"--callgrind-out-file={dumps}/out", os.path.join(folder, "umbraged"),
             "--store", store, "--listen", "tcp:127.0.0.1:0", "--workers", "1", "--loops", "1",
             "--address-file", address, "--drain-delay", "0"], stdout=log, stderr=log)
    try:
        ut.wait_until(lambda: os.path.exists(address), 120, "the daemon listens")
        with open(address, encoding="utf-8") as file:
            client = test.client(re.search(r"^tcp:(.*)$", file.read(), re.M).group(1))
        data = ut.floats(ut.random_points((-40, -40, 0), (40, 40, 20), points, 7))
        request = client.shadows.QueryRequest(asset="city", points=data, taps=taps)
        ask(client, request, WARM)
        dump(dumps, daemon)
        rounds = []
        for _ in range(ROUNDS):
            ask(client, request, CALLS)
            rounds.append(dump(dumps, daemon) / CALLS)
        client.close()
        return statistics.median(rounds)
    finally:
        daemon.terminate()
        daemon.wait()


def main():
    test = ut.Test(limit_s=1200)
    folders = [os.path.abspath(folder) for folder in sys.argv[1:]] or [ut.BUILD]
    scene = test.scene("city", 8)
    stores = []
    for number, folder in enumerate(folders):
        stores.append(test.path(f"store{number}"))
        os.makedirs(stores[-1])
        ut.run(os.path.join(folder, "umbrage-bake"), scene, "-o", stores[-1] + "/city.umb", "--resolution", "2048",
               "--sun", "135,45", "--verify", "0")
    for points, taps in BATCHES:
        first = None
        for folder, store in zip(folders, stores):
            each = counted(folder, test, store, points, taps)
            first = first or each
            print(f"{points:3} points, {taps} taps: {each:9.0f} instructions a call, "
                  f"{100 * (each / first - 1):+.1f} %, {os.path.relpath(folder, ut.ROOT)}", flush=True)
    test.finish()


main()
