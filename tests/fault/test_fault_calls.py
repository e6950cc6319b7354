#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A daemon that runs out of memory: one allocation fails during a call of each method of its services.
The call must be answered correctly or refused, the next call must be answered correctly, and the
daemon must not end. The same is tested outside calls: for connections over TLS, the admin port and
SIGHUP. If reads of an asset fail, a Fetch must end with an error, never with wrong bytes.
"""
import os
import shutil
import signal
import socket
import ssl
import subprocess
import time
import urllib.error

import fault_sweep as fs
from fault_sweep import ut

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
if shutil.which("openssl") is None:
    ut.skip("the openssl command is not installed")
test = ut.Test(limit_s=1800)
sweep = fs.Sweep(test)
S, B = test.messages.shadows, test.messages.bakes
R, Q = test.messages.regions, test.messages.questions
SEED = 7
POINTS = 40 if fs.SHORT else 200  # allocations of one kind of call that fail
MANY = 20000  # points; so many go to the workers
# Codes of a call that met the fault. UNAVAILABLE, INTERNAL, UNKNOWN: the connection or the stream
# was cut.
REFUSED = (Code.RESOURCE_EXHAUSTED, Code.UNAVAILABLE, Code.INTERNAL, Code.UNKNOWN, Code.CANCELLED)
# Makes a lost connection reconnect at once.
QUICK = [("grpc.initial_reconnect_backoff_ms", 20), ("grpc.min_reconnect_backoff_ms", 20),
         ("grpc.max_reconnect_backoff_ms", 50)]


def write(name, text):
    path = test.path(name)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w",
              encoding="ascii") as file:
        file.write(text)
    return path


subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
                "-nodes", "-days", "2", "-subj", "/CN=localhost", "-addext",
                "subjectAltName=DNS:localhost", "-keyout", "tls.key", "-out", "tls.pem"], check=True,
               stderr=subprocess.DEVNULL, cwd=test.folder)
TOKEN = [("authorization", "Bearer ann-0123456789abcdef")]
tokens = write("tokens", "ann query,submit,admin ann-0123456789abcdef\n")
config = write("config", "log-level = info\n")
os.mkdir(test.path("store"))
with open(test.scene("city", 2), "rb") as scene_file:
    scene = scene_file.read()
test.bake(test.scene("city", 2), test.path("store", "city.umb"), "--resolution", 512, "--verify", 0,
          "--closed", "off")
held, gate = test.held_bakes()

with sweep.injected("memory", "ENOMEM") as board:
    daemon = test.daemon("--workers", 1, "--jobs", test.path("jobs"), "--token-file", tokens,
                         "--bake-threads", 1, "--bake-program", held, "--job-sandbox", "off",
                         "--owner-jobs", 100000, "--address-handshakes", 0, "--config", config,
                         "--listen", "tls:127.0.0.1:0", "--tls-cert", test.path("tls.pem"),
                         "--tls-key", test.path("tls.key"))
client = test.client(daemon.grpc_unix, QUICK)
points = ut.floats(ut.random_points((-100, -100, -10), (100, 100, 80), MANY, SEED))
few = points[:240]
job = client.submit({"city.glb": scene}, "city.glb", metadata=TOKEN, resolution=512, sun="120,40", verify=1000)
status = client.finished_job(job.job, metadata=TOKEN)
assert status.state == B.JOB_DONE, status
ASSET = status.asset.hex() if isinstance(status.asset, bytes) else status.asset
with open(gate, "wb"):  # from here on a bake takes minutes: none disturbs the counts
    pass
waiting = client.submit({"city.glb": scene}, "city.glb", metadata=TOKEN, resolution=256, verify=1000)
ut.wait_until(lambda: next(client.watch_job(B.WatchRequest(job=waiting.job), metadata=TOKEN,
                                            timeout=60)).state == B.JOB_RUNNING, 20, "the held bake")

# ---- calls ----

regions = client.channel
pack = {"request_serializer": lambda m: m.SerializeToString()}
region_stream = regions.unary_stream("/umbrage.v1.Regions/Stream", **pack,
                                     response_deserializer=R.RegionReply.FromString)
region_follow = client.bidi("/umbrage.v1.Regions/Follow", R.RegionReply)
versions = regions.unary_stream("/umbrage.v1.Regions/Watch", **pack,
                                response_deserializer=R.RegionReply.FromString)
derive_map = regions.unary_stream("/umbrage.v1.Regions/DeriveMap", **pack,
                                  response_deserializer=R.RegionReply.FromString)
questions = {name: client.unary(f"/umbrage.v1.Questions/{name}", getattr(Q, name + "Reply"))
             for name in ("Segments", "Columns", "Boxes")}
reflection = test.messages.reflection
submissions = [0]


def query(**fields):
    reply = client.query(S.QueryRequest(**fields), timeout=60, metadata=TOKEN, wait_for_ready=True)
    return reply.visibility, reply.asset_id


def bytes_of(replies):
    return b"".join(reply.data for reply in replies)


def submit_new():
    submissions[0] += 1
    files = {"city.glb": scene, "note.txt": b"%d" % submissions[0]}
    reply = client.submit(files, "city.glb", metadata=TOKEN, resolution=256, verify=1000)
    assert not reply.existing
    client.cancel_job(B.CancelRequest(job=reply.job), metadata=TOKEN, timeout=60,
                      wait_for_ready=True)
    return True


def delete_nothing():
    try:
        meta(client.delete_asset, B.DeleteRequest(asset="0" * 64))
    except grpc.RpcError as error:
        if error.code() != Code.NOT_FOUND:
            raise
        return error.details()
    raise AssertionError("it was deleted")


def first_of(replies):
    value = next(iter(replies))
    replies.cancel()
    return value


def meta(method, request, first=False):
    replies = method(request, timeout=60, metadata=TOKEN, wait_for_ready=True)
    return first_of(replies) if first else replies


CALLS = {
    "Query of a few points": lambda: query(asset="city", points=few, taps=3),
    "Query of many points": lambda: query(asset="city", points=points, taps=3, want_stats=True),
    "Query with normals, packed": lambda: query(asset="city", points=points, normals=points,
                                                pack=True, format=S.ANSWER_BIT),
    "Query of two targets": lambda: query(points=points, targets=[S.Target(asset="city")] * 2),
    "Query with a budget": lambda: len(query(asset="city", points=points, budget_ns=1e9)[0]),
    "QueryStream": lambda: [reply.visibility for reply in meta(client.stream, iter(
        [S.QueryRequest(asset="city", points=few), S.QueryRequest(asset="city", points=points),
         S.QueryRequest(asset="city", points=few, pack=True)]))],
    "Describe": lambda: meta(client.describe, S.DescribeRequest(asset="city")),
    "Describe with curves": lambda: meta(client.describe, S.DescribeRequest(
        asset="city", want_curves=True)).plan,
    "List": lambda: meta(client.list, S.ListRequest()),
    "Limits": lambda: meta(client.limits, S.LimitsRequest()),
    "Health.Check": lambda: meta(client.check, test.messages.health.HealthCheckRequest()),
    "Health.Watch": lambda: meta(client.watch, test.messages.health.HealthCheckRequest(
        service="umbrage.v1.Shadows/city"), first=True),
    "reflection": lambda: [reply for reply in meta(client.reflect[0], iter(
        [reflection.ServerReflectionRequest(list_services=""),
         reflection.ServerReflectionRequest(file_containing_symbol="umbrage.v1.Shadows")]))],
    "Segments": lambda: meta(questions["Segments"], Q.SegmentsRequest(
        asset="city", segments=points[:len(points) // 24 * 24], max_stretches=4)),
    "Columns": lambda: meta(questions["Columns"], Q.ColumnsRequest(asset="city", points=points)),
    "Sample": lambda: meta(client.unary("/umbrage.v1.Shadows/Sample", S.SampleReply),
                           S.SampleRequest(asset="city", count=100, seed=1)),
    "Boxes": lambda: meta(questions["Boxes"], Q.BoxesRequest(asset="city", boxes=few)),
    "Regions.Stream": lambda: bytes_of(meta(region_stream, R.RegionRequest(
        asset="city", offsets=[0, 1000], lengths=[500, 700]))),
    "Regions.Follow": lambda: bytes_of(meta(region_follow, iter(
        [R.RegionRequest(asset="city", offsets=[0], lengths=[500])] * 2))),
    "Regions.Watch": lambda: meta(versions, R.VersionRequest(asset="city"), first=True).asset_id,
    "DeriveMap": lambda: bytes_of(meta(derive_map, R.DeriveMapRequest(
        asset="city", width=64, height=64))),
    "Submit of a known bundle": lambda: client.submit(
        {"city.glb": scene}, "city.glb", metadata=TOKEN, resolution=512, sun="120,40", verify=1000).job,
    "Submit and Cancel": submit_new,
    "Bakes.Watch": lambda: meta(client.watch_job, B.WatchRequest(job=job.job), first=True).job,
    "Bakes.List": lambda: len(meta(client.list_jobs, B.ListJobsRequest(limit=5)).jobs) > 1,
    "Fetch": lambda: bytes_of(meta(client.fetch, B.FetchRequest(asset=ASSET))),
    "Delete of an asset that is not there": delete_nothing,
}


def once_more(call):
    """Makes the call with memory; opens the connection again if it was lost meanwhile."""
    deadline = time.monotonic() + fs.HANG_S
    while True:
        try:
            return call()
        except grpc.RpcError as error:
            assert error.code() == Code.UNAVAILABLE and time.monotonic() < deadline, \
                f"with memory again: {error.code()}: {error.details()}"


def sweep_call(call, gentle=None):
    """Fails one allocation during each call; then makes the same call with memory."""
    wanted = call()
    before = board.calls
    assert call() == wanted, "two answers without any fault"
    count = board.calls - before
    failures = fs.Failures()
    refused = 0
    for at in sweep.points(count + count // 8, POINTS):
        with failures.point("allocation", at, "of", count):
            now = board.calls + at
            board.fail(now, now)
            try:
                assert call() == wanted, "another answer"
            except grpc.RpcError as error:
                refused += 1
                assert error.code() in REFUSED, f"{error.code()}: {error.details()}"
            except gentle or () as error:
                refused += 1
            finally:
                board.fail(0, 0)
            assert daemon.process.poll() is None, f"it died: {daemon.process.poll()}"
            assert once_more(call) == wanted, "another answer with memory again"
    print(f"    {count} allocations, {failures.done} faults, {refused} refused")
    failures.end()
    return refused


total = 0
for name, call in CALLS.items():
    with test.check(f"{name} without memory is answered right or refused"):
        total += sweep_call(call)
with test.check("some of those faults were noticed"):
    assert total > len(CALLS), total

# ---- connections, the admin port, SIGHUP ----


def shake_hands():
    """True if the daemon takes a TLS connection, settings and all."""
    context = ssl.create_default_context(cafile=test.path("tls.pem"))
    context.set_alpn_protocols(["h2"])
    host, _, port = daemon.addresses["tls"].rpartition(":")
    with socket.create_connection((host, int(port)), timeout=fs.HANG_S) as plain, \
            context.wrap_socket(plain, server_hostname="localhost") as secure:
        secure.sendall(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0]))
        return secure.recv(3)[:2] == b"\0\0"


def scrape():
    code, text = daemon.admin("/metrics")
    return code, "umbrage_connections" in text


def hang_up():
    """Sends SIGHUP; the daemon's own words about its config, tokens and certificates."""
    said = len(daemon.log())
    daemon.signal(signal.SIGHUP)

    def words():
        lines = daemon.log()[said:].splitlines()
        return [line for line in lines if "reloaded" in line and "what=config" in line]
    assert ut.wait_until(words, 5, "an answer to SIGHUP")
    return len(query(asset="city", points=few)[0])


DROPPED = (OSError, urllib.error.URLError, ssl.SSLError, AssertionError, EOFError)
with test.check("a TLS connection without memory comes about or is dropped"):
    assert shake_hands()
    sweep_call(shake_hands, gentle=DROPPED)
with test.check("a scrape without memory is answered, refused or dropped"):
    assert scrape() == (200, True)
    tries = fs.Failures()
    begun = board.calls
    scrape()
    for at in sweep.points(board.calls - begun + 2, POINTS):
        with tries.point("allocation", at):
            board.fail(board.calls + at, board.calls + at)
            try:
                code, whole = scrape()
                assert (code, whole) == (200, True) or code == 503, (code, whole)
            except (OSError, ValueError):
                pass
            finally:
                board.fail(0, 0)
            assert scrape() == (200, True)
    tries.end()
with test.check("SIGHUP without memory keeps settings, tokens and certificates, or takes them"):
    hang_up()
    sweep_call(hang_up)

client.close()
with test.check("after all that the daemon ends as ever"):
    os.remove(gate)
    daemon.stop()
test.daemons.remove(daemon)

# ---- reads of a file that fail ----

with sweep.injected("pread", "EIO") as board:
    daemon = test.daemon("--jobs", test.path("jobs"), "--token-file", tokens, "--bake-program", held,
                         "--job-sandbox", "off")
client = test.client(daemon.grpc_unix, QUICK)
with test.check("a Fetch whose file cannot be read fails, and sends no other bytes"):
    got = []

    def fetch():
        got.clear()
        for reply in meta(client.fetch, B.FetchRequest(asset=ASSET)):
            got.append(reply.data)
        return b"".join(got)

    before = board.calls
    whole_file = fetch()
    reads = board.calls - before
    assert reads > 0 and len(whole_file) > 1000
    failing = fs.Failures()
    for at in sweep.points(reads, POINTS):
        with failing.point("read", at):
            board.fail(board.calls + at, board.calls + at)
            try:
                assert fetch() == whole_file
            except grpc.RpcError as error:
                assert error.code() in (Code.INTERNAL, Code.DATA_LOSS, Code.UNKNOWN), error
                assert whole_file.startswith(b"".join(got))
            finally:
                board.fail(0, 0)
            assert fetch() == whole_file
    failing.end()
with test.check("the daemon ends as ever"):
    client.close()
    daemon.stop()
test.daemons.remove(daemon)

# ---- calls of a start that fail ----


def answers(process, address):
    """True once a new daemon answers; False if it ends instead."""
    deadline = time.monotonic() + fs.HANG_S
    asked = test.client("unix:" + address, QUICK)
    try:
        while process.poll() is None:
            try:
                reply = asked.query(S.QueryRequest(asset="city", points=few), timeout=1)
                assert len(reply.visibility) > 0
                return True
            except grpc.RpcError as error:
                assert time.monotonic() < deadline, f"it never answers: {error}"
        return False
    finally:
        asked.close()


def start(board_words, at):
    """Exit code and stderr of a daemon whose start meets the fault; code None: it served."""
    address = test.path("s.sock")
    words = [ut.program("umbraged"), "--store", test.path("store"), "--listen", "unix:" + address,
             "--listen", "tcp:127.0.0.1:0", "--admin", "127.0.0.1:0", "--workers", "2", "--loops",
             "2", "--jobs", test.path("jobs2"), "--job-sandbox", "off", "--drain-delay", "0",
             "--bake-program", held, "--address-file", test.path("addresses")]
    if os.path.exists(test.path("addresses")):
        os.remove(test.path("addresses"))
    with sweep.injected("system", board_words, at=at) as counts, \
            open(test.path("stderr"), "wb+") as err:
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=err)
        try:
            deadline = time.monotonic() + fs.HANG_S
            while process.poll() is None and not os.path.exists(test.path("addresses")):
                assert time.monotonic() < deadline, "it neither starts nor ends"
                time.sleep(0.005)
            served = process.poll() is None
            begun = counts.calls
            if served:
                counts.fail(0, 0)
                assert answers(process, address), "it has written its addresses and gives up"
                process.send_signal(signal.SIGTERM)
            code = process.wait(fs.HANG_S)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
        err.seek(0)
        return served, code, err.read().decode(errors="replace"), begun


for error_name in ("EMFILE", "EACCES"):
    with test.check(f"a start whose system calls fail with {error_name} ends with a sentence or serves"):
        served, code, text, count = start(error_name, 0)
        assert served and code == 0, text
        ends = fs.Failures()
        given_up = 0
        for at in sweep.points(count, 40 if fs.SHORT else 400):
            with ends.point("call", at, "of", count):
                served, code, text, _ = start(error_name, at)
                said = [line for line in text.splitlines() if line.startswith("umbraged: ")]
                assert code == 0 if served else code in (69, 71, 73, 74, 75, 77) and len(said) == 1, \
                    f"code {code}: {text[-500:]}"
                given_up += not served
        print(f"    {count} calls, {ends.done} starts, {given_up} gave up")
        ends.end()
        assert given_up > 0

test.finish()
