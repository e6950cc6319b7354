# SPDX-License-Identifier: Apache-2.0
"""
The way from an interop suite to its daemon, named by UMBRAGE_INTEROP: tcp (the default), unix, tls or
haproxy. haproxy uses the shipped configuration, in which all replicas are the one daemon.
"""
import atexit
import os
import shutil
import socket
import subprocess

import umbrage_test as ut

NAME = os.environ.get("UMBRAGE_INTEROP", "tcp")


def daemon_options(test):
    """What the daemon needs beside its usual options."""
    if NAME != "tls":
        return []
    if shutil.which("openssl") is None:
        ut.skip("the openssl command is not installed")
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                    "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout",
                    test.path("key.pem"), "-out", test.path("ca.pem")], check=True, stderr=subprocess.DEVNULL)
    return ["--listen", "tls:127.0.0.1:0", "--tls-cert", test.path("ca.pem"), "--tls-key", test.path("key.pem")]


def start_haproxy(*replicas):
    """HAProxy with the shipped configuration; HOST:PORT of its front end. It ends with the test."""
    if shutil.which("haproxy") is None:
        ut.skip("haproxy is not installed")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        frontend = f"127.0.0.1:{probe.getsockname()[1]}"
    addresses = {f"UMBRAGE_R{i + 1}": replicas[i % len(replicas)] for i in range(3)}
    proxy = subprocess.Popen(
        ["haproxy", "-db", "-f", os.path.join(ut.ROOT, "deploy", "haproxy", "haproxy.cfg")],
        env={**os.environ, **addresses, "UMBRAGE_FRONTEND": frontend}, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL)
    atexit.register(proxy.kill)
    ut.wait_until(lambda: proxy.poll() is not None or socket.socket().connect_ex(
        ("127.0.0.1", int(frontend.rpartition(":")[2]))) == 0, 10, "the proxy listens")
    assert proxy.poll() is None, "haproxy ended: " + str(proxy.returncode)
    return frontend


def client(test, daemon):
    """A python3-grpcio client that comes this way."""
    if NAME == "tcp":
        return test.client(daemon.grpc_tcp)
    if NAME == "unix":
        return test.client(daemon.grpc_unix)
    if NAME == "tls":
        grpc, _ = ut.need_grpc()
        with open(test.path("ca.pem"), "rb") as file:
            return test.client(daemon.addresses["tls"], credentials=grpc.ssl_channel_credentials(file.read()))
    assert NAME == "haproxy", f"UMBRAGE_INTEROP={NAME} is not tcp, unix, tls or haproxy"
    through = test.client(start_haproxy(daemon.grpc_tcp))
    ut.wait_until(lambda: through.check(test.messages.health.HealthCheckRequest(), timeout=10,
                                        wait_for_ready=True).status == 1, 20, "the proxy serves")
    return through
