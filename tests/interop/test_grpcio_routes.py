#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The whole suite of test_grpcio.py again, over a Unix socket, TLS and, where it is installed, HAProxy."""
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

ut.need_grpc()
failed = 0
for route in ("unix", "tls", "haproxy"):
    if route == "haproxy" and shutil.which("haproxy") is None:
        ut.left_out("grpcio over HAProxy", "haproxy is not installed")
        continue
    done = subprocess.run([sys.executable, os.path.join(os.path.dirname(os.path.abspath(__file__)), "test_grpcio.py")],
                          env={**os.environ, "UMBRAGE_INTEROP": route}, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, timeout=280, check=False)
    text = done.stdout.decode(errors="replace")
    print(f"{'ok' if done.returncode == 0 else 'FAILED'} {route}: {text.splitlines()[-1] if text else 'nothing said'}")
    if done.returncode != 0:
        failed += 1
        print(text)
raise SystemExit(1 if failed else 0)
