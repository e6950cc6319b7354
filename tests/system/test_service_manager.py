#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The daemon under a service manager: states and signs of life over its socket, settings from a file, read
again on SIGHUP, and JSON logs.
"""
import json
import os
import signal
import socket
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
os.mkdir(test.path("store"))
os.mkdir(test.path("second"))
notices = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
notices.bind(test.path("notify"))
notices.settimeout(20)
config = test.path("umbraged.conf")


def write_config(*lines):
    with open(config + ".new", "w", encoding="ascii") as file:
        file.write("[umbraged]\n" + "".join(line + "\n" for line in lines))
    os.rename(config + ".new", config)


def next_notice(first):
    """The next notice that begins so; others are passed over."""
    while True:
        text = notices.recv(4096).decode()
        if text.startswith(first):
            return text


def events(daemon):
    return [json.loads(line) for line in daemon.log().splitlines()]


with test.check("settings of a file are those of the command line"):
    write_config(f"store = {test.path('store')}", "workers = 3", "log-format = json")
    done = ut.run("umbraged", "--config", config, "--print-config")
    assert b"workers = 3\n" in done.stdout and b"log-format = json\n" in done.stdout
    ut.run("umbraged", "--config", config, "--check-config")
with test.check("a bad file is exit code 78 and one sentence with its line"):
    write_config("store = /tmp", "colour = red")
    for option in ("--check-config", "--print-config"):
        done = ut.run("umbraged", "--config", config, option, code=78)
        assert b"line 3" in done.stderr and b"colour" in done.stderr, done.stderr
        assert done.stderr.count(b"\n") == 1
    ut.run("umbraged", "--config", test.path("nowhere"), "--check-config", code=66)

write_config(f"store = {test.path('store')}", f"store = {test.path('second')}", "log-format = json")
os.environ["NOTIFY_SOCKET"] = test.path("notify")
os.environ["WATCHDOG_USEC"] = "600000"
daemon = test.daemon("--config", config)
with test.check("the manager hears READY after the start, then signs of life"):
    assert "READY=1" in next_notice("READY=1")
    begin = time.monotonic()
    for _ in range(3):
        next_notice("WATCHDOG=1")
    assert time.monotonic() - begin < 5
with test.check("every line of the log is a JSON object"):
    names = [event["event"] for event in events(daemon)]
    assert "ready" in names and "listening" in names, names
    assert all(event["ts"].endswith("Z") for event in events(daemon))
with test.check("SIGHUP takes the log level over and says what waits for a restart"):
    write_config(f"store = {test.path('store')}", "log-format = json", "log-level = debug", "workers = 5")
    daemon.signal(signal.SIGHUP)
    next_notice("RELOADING=1")
    next_notice("READY=1")
    ut.wait_until(lambda: any(e["event"] == "reloaded" for e in events(daemon)), 10, "reloaded")
    waiting = [e["setting"] for e in events(daemon) if e["event"] == "restart_needed"]
    assert waiting == ["workers = 5"], waiting
with test.check("SIGHUP with a bad file changes nothing and says why"):
    write_config("colour = red")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: any(e["event"] == "not_reloaded" and "colour" in e["reason"]
                              for e in events(daemon)), 10, "not_reloaded")
    assert daemon.admin("/readyz")[0] == 200
with test.check("the manager hears STOPPING at the drain"):
    daemon.signal(signal.SIGTERM)
    next_notice("STOPPING=1")
    daemon.exited()
del os.environ["NOTIFY_SOCKET"], os.environ["WATCHDOG_USEC"]
test.finish()
