#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""A daemon that gets SIGTERM again and again while it ends must still exit with 0. A command that is interrupted while
it writes must leave no temporary behind, and a long one must show its progress. Programs that are started without
standard streams must not print into one of their files.

libuv gives a signal its default action back when its handle closes; a SIGTERM in that last moment
used to kill the process (13 of 30 runs).
"""
import json
import os
import pty
import select
import signal
import subprocess
import sys
import tempfile
import time

BUILD = os.environ.get("BUILD", "build/release")
ROUNDS = 20


# Runs its arguments as a command without any of the standard descriptors.
CLOSED = ["sh", "-c", "exec \"$@\" <&- >&- 2>&-", "sh"]


def storm(folder, before=()):
    """Starts a daemon, sends SIGTERM until it is gone, returns its exit code."""
    os.mkdir(os.path.join(folder, "store"))
    addresses = os.path.join(folder, "addresses")
    daemon = subprocess.Popen(
        [*before, os.path.join(BUILD, "umbraged"), "--store", os.path.join(folder, "store"), "--listen",
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
        # A command whose output was in place before the signal must leave the output, and nothing
        # else.
        if (code, left) not in ((-number, []), (-number, ["city.umbm"]), (0, ["city.umbm"])):
            return 1
    return interrupt_boxes(folder)


def interrupt_boxes(folder):
    """Returns 1 unless boxes that take long show their progress on a terminal, and end at Ctrl-C."""
    boxes = os.path.join(folder, "boxes")
    with open(boxes, "w", encoding="ascii") as file:
        file.write("-1e4 -1e4 -1e4 1e4 1e4 1e4\n" * 5000)  # hours
    child, terminal = pty.fork()
    if child == 0:
        os.execv(build("umbrage"), ["umbrage", "query", os.path.join(folder, "city.umb"), "--boxes",
                                    boxes, "-o", os.path.join(folder, "shares")])
    shown = b""
    while b"boxes/s" not in shown and select.select([terminal], [], [], 120)[0]:
        shown += os.read(terminal, 4096)
    print("boxes:", shown[:80])
    os.write(terminal, b"\x03")
    try:
        while os.read(terminal, 4096):
            pass
    except OSError:  # the terminal's other end is closed
        pass
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    left = [name for name in os.listdir(folder) if "tmp" in name or "shares" in name]
    print("boxes, interrupted:", code, left)
    return int(b" left" not in shown or code != -signal.SIGINT or left != [])


def bake_without_streams(folder):
    """Returns 1 unless a bake with many messages and no standard streams writes the same asset as
    any other."""
    scene = os.path.join(folder, "city.glb")
    subprocess.run([build("scenegen"), "city", "--size", "2", "--seed", "1", "-o", scene], check=True)
    baked = []
    for number, before in enumerate(([], CLOSED)):
        out = os.path.join(folder, f"{number}.umb")
        code = subprocess.run([*before, build("umbrage-bake"), scene, "-o", out, "--resolution", "256",
                               "--json"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              check=False).returncode
        if code != 0:
            print("baked without streams:" if before else "baked:", code)
            return 1
        told = subprocess.run([build("umbrage"), "info", "--json", out], check=True,
                              stdout=subprocess.PIPE).stdout
        baked.append(json.loads(told)["asset"])
    print("baked without streams:", baked)
    return baked[0] != baked[1]


def main():
    with tempfile.TemporaryDirectory() as folder:
        if interrupt_commands(folder) != 0 or bake_without_streams(folder) != 0:
            return 1
    with tempfile.TemporaryDirectory() as folder:
        code = storm(folder, CLOSED)
        print("without streams:", code)
        if code != 0:
            return 1
    codes = []
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            codes.append(storm(folder))
    print("exit codes:", codes)
    return 0 if codes == [0] * ROUNDS else 1


if __name__ == "__main__":
    sys.exit(main())
