#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A daemon that is told to leave again and again while it leaves still exits with 0.

libuv gives a signal its default action back when its handle closes; a SIGTERM in that last moment
used to kill the process (13 of 30 runs).
"""
import os
import signal
import subprocess
import sys
import tempfile
import time

BUILD = os.environ.get("BUILD", "build/release")
ROUNDS = 20


def storm(folder):
    """Starts a daemon, sends SIGTERM until it is gone, returns its exit code."""
    os.mkdir(os.path.join(folder, "store"))
    addresses = os.path.join(folder, "addresses")
    daemon = subprocess.Popen(
        [os.path.join(BUILD, "umbraged"), "--store", os.path.join(folder, "store"), "--listen",
         "tcp:127.0.0.1:0", "--address-file", addresses, "--drain-delay", "0ms", "--log-level", "error"])
    deadline = time.monotonic() + 20
    while not os.path.exists(addresses) and daemon.poll() is None:
        if time.monotonic() > deadline:
            daemon.kill()
        time.sleep(0.01)
    while daemon.poll() is None:
        if time.monotonic() > deadline:
            daemon.kill()
        daemon.send_signal(signal.SIGTERM)
        time.sleep(0.0002)
    return daemon.returncode


def main():
    codes = []
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            codes.append(storm(folder))
    print("exit codes:", codes)
    return 0 if codes == [0] * ROUNDS else 1


if __name__ == "__main__":
    sys.exit(main())
