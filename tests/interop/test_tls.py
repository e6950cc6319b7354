#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
TLS as real clients see it: python3-grpcio and Python's ssl module connect to `tls:` addresses, with
and without certificates of clients. The certificates are made here, by the openssl command.
"""
import os
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time
import warnings

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import raw_http2 as h2  # noqa: E402
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
if shutil.which("openssl") is None:
    ut.skip("the openssl command is not installed")
Code = grpc.StatusCode
test = ut.Test()
M = test.messages.shadows
COUNT = 65536


def openssl(*words):
    subprocess.run(["openssl", *words], check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL, cwd=test.folder)


def authority(name):
    openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days",
            "2", "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.pem")


def certificate(name, by, subject):
    """A key and a certificate for `subject`, signed by an authority."""
    openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj",
            f"/CN={subject}", "-keyout", f"{name}.key", "-out", f"{name}.csr")
    with open(test.path(f"{name}.ext"), "w", encoding="ascii") as file:
        file.write(f"subjectAltName=DNS:{subject},IP:127.0.0.1\n")
    openssl("x509", "-req", "-in", f"{name}.csr", "-CA", f"{by}.pem", "-CAkey", f"{by}.key",
            "-CAcreateserial", "-days", "2", "-extfile", f"{name}.ext", "-out", f"{name}.pem")


def read(name):
    with open(test.path(name), "rb") as file:
        return file.read()


authority("ca")
authority("other")
certificate("server", "ca", "localhost")
certificate("client", "ca", "somebody")
certificate("stranger", "other", "somebody")

store = test.path("store")
os.mkdir(store)
test.bake(test.scene("city", 3), store + "/city.umb", "--resolution", 256, "--depth", "raster",
          "--verify", 0)
TLS = ("--listen", "tls:127.0.0.1:0", "--tls-cert", test.path("server.pem"), "--tls-key",
       test.path("server.key"))
daemon = test.daemon(*TLS, "--handshake-timeout", "2s")
address = daemon.addresses["tls"]
port = int(address.rpartition(":")[2])
plain = test.client(daemon.grpc_tcp)


def secure(target, ca="ca", own=None):
    """A client over TLS; own: name of its certificate."""
    credentials = grpc.ssl_channel_credentials(
        read(f"{ca}.pem"), *((read(f"{own}.key"), read(f"{own}.pem")) if own else ()))
    return test.client(target, credentials=credentials)


def shake(to, alpn=("h2",), highest=None):
    """A TLS connection by Python's ssl; returns it or raises."""
    context = ssl.create_default_context(cafile=test.path("ca.pem"))
    if alpn:
        context.set_alpn_protocols(alpn)
    if highest:
        warnings.simplefilter("ignore", DeprecationWarning)  # old versions are meant
        context.minimum_version = ssl.TLSVersion.TLSv1
        context.maximum_version = highest
        context.set_ciphers("ALL:@SECLEVEL=0")
    raw = socket.create_connection(("127.0.0.1", to), timeout=60)
    return context.wrap_socket(raw, server_hostname="localhost")


about = plain.describe(M.DescribeRequest(asset="city"), timeout=60)
points = ut.floats(ut.random_points(about.bounds_min, about.bounds_max, COUNT, 7))
client = secure(address)

with test.check("answers over TLS are those over TCP, for every size of batch"):
    for count in (0, 1, 64, 1365, 1366, 5000, COUNT):
        for fields in ({"format": M.ANSWER_F32}, {"taps": 3, "want_stats": False}):
            request = M.QueryRequest(asset="city", points=points[:12 * count], **fields)
            assert client.query(request, timeout=60) == plain.query(request, timeout=60)
with test.check("a stream over TLS answers in order"):
    asked = [M.QueryRequest(asset="city", points=points[:12 * n]) for n in (1, COUNT, 64, 9000) * 3]
    assert list(client.stream(iter(asked), timeout=60)) == [plain.query(r, timeout=60) for r in asked]
with test.check("TLS 1.2 and 1.3 are spoken, 1.1 is not"):
    for version, name in ((ssl.TLSVersion.TLSv1_2, "TLSv1.2"), (ssl.TLSVersion.TLSv1_3, "TLSv1.3")):
        with shake(port, highest=version) as connection:
            assert connection.version() == name
            assert connection.selected_alpn_protocol() == "h2"
    try:
        shake(port, highest=ssl.TLSVersion.TLSv1_1)
        raise AssertionError("TLS 1.1 was accepted")
    except (ssl.SSLError, ConnectionError):
        pass


def is_cut(connection):
    """The server ends it without a byte of HTTP/2."""
    try:
        return connection.recv(100) == b""
    except (ssl.SSLError, ConnectionError):
        return True


with test.check("a client that offers another protocol than h2, or none, is cut"):
    for alpn in (("http/1.1",), ()):
        try:
            with shake(port, alpn=alpn) as connection:
                assert is_cut(connection), alpn
        except (ssl.SSLError, ConnectionError):
            pass
with test.check("plain HTTP/2 and noise on a TLS port are cut at once, and counted"):
    before = daemon.metric("umbrage_tls_failures_total")
    for data in (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(9), b"\xff" * 300, b"GET / HTTP/1.1\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
            connection.sendall(data)
            try:
                while connection.recv(1000):
                    pass
            except ConnectionError:
                pass
    assert daemon.metric("umbrage_tls_failures_total") == before + 3
with test.check("a client that says goodbye has not failed"):
    before = daemon.metric("umbrage_tls_failures_total")
    for _ in range(3):
        connection = shake(port)
        connection.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0]))
        connection.recv(9)
        try:
            connection.unwrap().close()
        except (ssl.SSLError, OSError):
            connection.close()  # bytes of HTTP/2 were still on their way
    time.sleep(0.5)
    assert daemon.metric("umbrage_tls_failures_total") == before
with test.check("a handshake that does not go on is cut by its timer"):
    with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
        connection.sendall(b"\x16\x03\x01\x02\x00\x01")
        begin = time.monotonic()
        assert connection.recv(100) == b""
        assert 1 < time.monotonic() - begin < 8
with test.check("records that arrive byte by byte are put together"):
    context = ssl.create_default_context(cafile=test.path("ca.pem"))
    context.set_alpn_protocols(["h2"])
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    session = context.wrap_bio(incoming, outgoing, server_hostname="localhost")
    with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for _ in range(20):
            try:
                session.do_handshake()
                break
            except ssl.SSLWantReadError:
                for byte in outgoing.read():
                    connection.sendall(bytes([byte]))
                incoming.write(connection.recv(65536))
        session.write(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0]))
        for byte in outgoing.read():
            connection.sendall(bytes([byte]))
        data = b""
        while len(data) < 9:
            try:
                data += session.read(1000)
            except ssl.SSLWantReadError:
                incoming.write(connection.recv(65536))
        assert data[3] == 4, "the first frame is SETTINGS"
with test.check("a client that trusts another authority does not connect"):
    stranger = secure(address, ca="other")
    stranger.refused(lambda: stranger.ask("city", timeout=60), Code.UNAVAILABLE)
    stranger.close()

mutual = test.daemon(*TLS, "--tls-client-ca", test.path("ca.pem"))
with test.check("with --tls-client-ca only clients with its certificates are answered"):
    for own, welcome in (("client", True), ("stranger", False), (None, False)):
        peer = secure(mutual.addresses["tls"], own=own)
        if welcome:
            assert len(peer.ask("city", points[:120]).visibility) == 10
        else:
            peer.refused(lambda: peer.ask("city", timeout=60), Code.UNAVAILABLE)
        peer.close()



def wrap(own):
    """What makes a raw connection one over TLS, showing a certificate of its own."""
    context = ssl.create_default_context(cafile=test.path("ca.pem"))
    context.set_alpn_protocols(["h2"])
    if own:
        context.load_cert_chain(test.path(own + ".pem"), test.path(own + ".key"))
    return lambda plain_socket: context.wrap_socket(plain_socket, server_hostname="localhost")


LIST, NO_BYTES = "/umbrage.v1.Shadows/List", h2.prefixed(b"")
certificate("second", "ca", "another client")


def clients_of(to, *owns):
    """A raw connection for each certificate that has been answered."""
    connections = [h2.Connection(port=int(to.addresses["tls"].rpartition(":")[2]), wrap=wrap(own), timeout=30)
                   for own in owns]
    for connection in connections:
        assert connection.call(LIST, NO_BYTES).status == 0
    return connections


def write(name, *sources):
    with open(test.path(name), "wb") as file:
        for source in sources:
            file.write(read(source))


with test.check("authorities that --tls-client-ca names no more lose their open connections, others do not"):
    write("clients.pem", "ca.pem", "other.pem")
    narrowing = test.daemon(*TLS, "--tls-client-ca", test.path("clients.pem"))
    stays, goes = clients_of(narrowing, "client", "stranger")
    narrowing.signal(signal.SIGHUP)  # the same authorities again: nothing changes
    ut.wait_until(lambda: "event=reloaded what=tls" in narrowing.log(), 10, "the reload")
    assert not goes.wait(lambda: goes.goaway is not None, 0.5) and goes.call(LIST, NO_BYTES).status == 0
    write("clients.pem", "ca.pem")
    narrowing.signal(signal.SIGHUP)
    assert goes.wait(lambda: goes.closed, 20), "its connection stays open"
    assert "event=conn_revoked" in narrowing.log()
    assert stays.call(LIST, NO_BYTES).status == 0, "a connection that is still admitted was closed"
    narrowing.stop()
with test.check("a certificate on --tls-crl is refused, and its open connections end at SIGHUP"):
    with open(test.path("crl.cnf"), "w", encoding="ascii") as file:
        file.write("[ca]\ndefault_ca=own\n[own]\ndatabase=revoked.txt\ndefault_md=sha256\ndefault_crl_days=2\n")
    with open(test.path("revoked.txt"), "w", encoding="ascii"):
        pass
    by = ("-config", "crl.cnf", "-cert", "ca.pem", "-keyfile", "ca.key")
    openssl("ca", *by, "-gencrl", "-out", "ca.crl")
    listing = test.daemon(*TLS, "--tls-client-ca", test.path("ca.pem"), "--tls-crl", test.path("ca.crl"))
    stays, goes = clients_of(listing, "second", "client")
    openssl("ca", *by, "-revoke", "client.pem")
    openssl("ca", *by, "-gencrl", "-out", "ca.crl")
    listing.signal(signal.SIGHUP)
    assert goes.wait(lambda: goes.closed, 20), "its connection stays open"
    assert stays.call(LIST, NO_BYTES).status == 0
    peer = secure(listing.addresses["tls"], own="client")
    peer.refused(lambda: peer.ask("city", timeout=60), Code.UNAVAILABLE)
    peer.close()
    write("ca.crl", "ca.pem")  # no list at all: what was read before stays
    listing.signal(signal.SIGHUP)
    ut.wait_until(lambda: "not_reloaded what=tls" in listing.log(), 10, "the complaint")
    os.unlink(test.path("ca.crl"))
    os.mkfifo(test.path("ca.crl"))  # a pipe whose writer never comes must not stop the loop
    listing.signal(signal.SIGHUP)
    ut.wait_until(lambda: "ca.crl' is not a regular file" in listing.log(), 10, "the complaint")
    assert stays.call(LIST, NO_BYTES).status == 0
    listing.stop()
    done = subprocess.run([ut.program("umbraged"), "--store", store, "--tls-crl", test.path("ca.crl")],
                          capture_output=True, timeout=60, check=False)
    assert done.returncode == 2 and b"--tls-client-ca" in done.stderr, done
with test.check("TLS handshakes of an address have a rate, its open connections and others do not"):
    rated = test.daemon(*TLS, "--address-handshakes", 5)
    to = int(rated.addresses["tls"].rpartition(":")[2])

    def shakes(source):
        try:
            connection = h2.Connection(port=to, wrap=wrap(None), source=source, timeout=30)
            return connection if connection.call(LIST, NO_BYTES).status == 0 else None
        except (OSError, AssertionError):
            return None
    made, deadline = [], time.monotonic() + 60
    while None not in made and time.monotonic() < deadline:
        made.append(shakes("127.0.0.3"))
    assert None in made and made[0] is not None, made
    assert rated.metric("umbrage_handshakes_refused_total") >= 1
    assert shakes("127.0.0.4") is not None
    assert made[0].call(LIST, NO_BYTES).status == 0
    ut.wait_until(lambda: shakes("127.0.0.3") is not None, 30, "the debt is paid")
    rated.stop()
with test.check("SIGHUP takes a new certificate for new connections; a bad one changes nothing"):
    def served():
        with shake(port) as connection:
            return connection.getpeercert()["serialNumber"]
    first = served()
    certificate("server", "ca", "localhost")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: served() != first, 10, "the new certificate")
    second = served()
    assert client.ask("city", points[:120]).visibility  # the old connection lives on
    with open(test.path("server.pem"), "w", encoding="ascii") as file:
        file.write("nonsense\n")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: "not_reloaded what=tls" in daemon.log(), 10, "the complaint")
    assert served() == second
with test.check("a key under a password is refused, and nobody is asked for it"):
    certificate("locked", "ca", "localhost")
    openssl("ec", "-in", "locked.key", "-aes128", "-passout", "pass:secret", "-out", "locked2.key")
    done = subprocess.run(
        [ut.program("umbraged"), "--store", store, "--listen", "tls:127.0.0.1:0", "--tls-cert",
         test.path("locked.pem"), "--tls-key", test.path("locked2.key"), "--address-file",
         "/proc/none/none"], input=b"secret\n", stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True, timeout=30, check=False)  # without a terminal it asks its input
    assert done.returncode == 2 and b"--tls-key" in done.stderr, done
with test.check("tls: without a certificate is a usage error"):
    done = ut.run("umbraged", "--store", store, "--listen", "tls:127.0.0.1:0", code=2)
    assert b"--tls-cert" in done.stderr

def ours(*words, code=0, env=None):
    """Runs `umbrage` with TLS options; every reason that it prints must be one line."""
    done = ut.run("umbrage", *words, code=code, env=env)
    assert code == 0 or done.stderr.count(b"\n") == 1, done.stderr
    return done


with test.check("umbrage over tls: answers as over tcp:, by address and by name, small and large"):
    ours_tls, tcp = "tls:" + address, "tcp:" + daemon.addresses["tcp"]
    host = f"tls:localhost:{port}"
    with open(test.path("many.f32"), "wb") as file:
        file.write(ut.floats(ut.random_points((0, 0, 0), (100, 100, 50), COUNT, 7)))
    many = ("city", "--points", test.path("many.f32"), "--format", "f32", "--encoding", "u8")
    ca = ("--tls-ca", test.path("ca.pem"))
    expected = ours("query", *many, "--address", tcp).stdout
    assert len(expected) == COUNT
    for to in (ours_tls, host):
        assert ours("query", *many, "--address", to, *ca).stdout == expected
        assert ours("query", *many, "--batch", 800, "--address", to, *ca).stdout == expected
with test.check("umbrage refuses a server that it has no reason to trust, and says why"):
    for extra, code, reason in ((("--tls-ca", test.path("other.pem")), 77, b"not trusted"),
                                ((), 77, b"not trusted"),
                                ((*ca, "--tls-name", "elsewhere"), 77, b"ostname mismatch"),
                                (("--tls-ca", test.path("none.pem")), 66, b"none.pem"),
                                ((*ca, "--tls-cert", test.path("other.pem"), "--tls-key",
                                  test.path("client.key")), 2, b"key_file"),
                                ((*ca, "--tls-key", test.path("client.key")), 2, b"certificate")):
        assert reason in ours("list", "--address", ours_tls, *extra, code=code).stderr, reason
    assert b"city" in ours("list", "--address", ours_tls, *ca, "--tls-name", "localhost").stdout
    # The certificate names 127.0.0.1, so the same server at another address must be refused.
    certificate("server", "ca", "localhost")
    elsewhere = test.daemon("--listen", "tls:127.0.0.2:0", *TLS[2:])
    at = elsewhere.addresses["tls"]
    assert at.startswith("127.0.0.2:"), at
    done = ours("list", "--address", "tls:" + at, *ca, code=77)
    assert b"mismatch" in done.stderr, done
    assert b"city" in ours("list", "--address", "tls:" + at, *ca, "--tls-name", "localhost").stdout
    ours("list", "--address", "tls:" + at, *ca, "--tls-name", "127.0.0.3", code=77)
    elsewhere.stop()
    # Neither TLS nor plain text understands the other; neither side may wait for the other.
    assert b"no TLS" in ours("list", "--address", "tls:" + tcp[4:], *ca, code=69).stderr
    ours("list", "--address", "tcp:" + address, code=69)
    assert b"tls:" in ours("list", "--address", tcp, *ca, code=2).stderr
with test.check("umbrage shows its certificate where one is asked for"):
    to = ("--address", "tls:" + mutual.addresses["tls"], *ca)
    pair = {own: ("--tls-cert", test.path(f"{own}.pem"), "--tls-key", test.path(f"{own}.key"))
            for own in ("client", "stranger")}
    assert b"city" in ours("list", *to, *pair["client"]).stdout
    for extra in ((), pair["stranger"]):
        done = ours("list", *to, *extra, code=None)
        assert done.returncode in (69, 77) and done.stderr.count(b"\n") == 1, done
with test.check("umbrage sends its token, from a file or the environment, and only a proper one"):
    with open(test.path("tokens"), "w", encoding="ascii") as file:
        file.write("studio query 0123456789abcdef\n")
    os.chmod(test.path("tokens"), 0o600)
    certificate("server", "ca", "localhost")
    guarded = test.daemon(*TLS, "--token-file", test.path("tokens"))
    to = ("--address", "tls:" + guarded.addresses["tls"], *ca)
    for text, code in (("0123456789abcdef\n", 0), ("0123456789abcdeX", 77), ("two words", 2), ("", 2)):
        with open(test.path("token"), "w", encoding="ascii") as file:
            file.write(text)
        ours("list", *to, "--token-file", test.path("token"), code=code)
    ours("list", *to, code=77)
    ours("list", *to, env={"UMBRAGE_TOKEN": "0123456789abcdef"})
    ours("list", *to, "--token-file", test.path("absent"), code=66)
for one in (client, plain):
    one.close()
test.finish()
