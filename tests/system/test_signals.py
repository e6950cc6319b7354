#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A daemon that is told to leave again and again while it leaves still exits with 0; a command that is
interrupted while it writes leaves no temporary behind.

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


def build(name):
    return os.path.join(BUILD, name)


def interrupted(folder, number):
    """Interrupts `umbrage unpack` as soon as its temporary is there; returns exit code and files."""
    out = os.path.join(folder, f"out{number}")
    os.mkdir(out)
    command = subprocess.Popen([build("umbrage"), "unpack", os.path.join(folder, "city.umb"), "-o",
                                os.path.join(out, "city.umbm")], stderr=subprocess.DEVNULL)
    while not os.listdir(out) and command.poll() is None:
        time.sleep(0.0005)
    command.send_signal(number)
    return command.wait(20), os.listdir(out)


def interrupt_commands(folder):
    scene = os.path.join(folder, "city.glb")
    subprocess.run([build("scenegen"), "city", "--size", "6", "--seed", "1", "-o", scene], check=True)
    subprocess.run([build("umbrage-bake"), scene, "-o", os.path.join(folder, "city.umb"),
                    "--resolution", "8192", "--depth", "raster", "--verify", "0", "--quiet"],
                   check=True)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        code, left = interrupted(folder, number)
        print("interrupted:", code, left)
        # A command that had finished before the signal came has its whole output and nothing else.
        if (code, left) not in ((-number, []), (0, ["city.umbm"])):
            return 1
    return 0


def main():
    with tempfile.TemporaryDirectory() as folder:
        if interrupt_commands(folder) != 0:
            return 1
    codes = []
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            codes.append(storm(folder))
    print("exit codes:", codes)
    return 0 if codes == [0] * ROUNDS else 1


if __name__ == "__main__":
    sys.exit(main())
