#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Bearer tokens and rates, as python3-grpcio sees them."""
import os
import queue
import signal
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
M = test.messages.shadows
H = test.messages.health
R = test.messages.reflection
GOOD, OTHER, SLOW = "studio-0123456789abcdef", "robot-0123456789abcdef", "slow-0123456789abcdef0"
BOXES = "boxes-0123456789abcdef"

store = test.path("store")
os.mkdir(store)
test.bake(test.scene("city", 3), store + "/city.umb", "--resolution", 256, "--depth", "raster",
          "--closed", "off", "--verify", 0)
tokens = test.path("tokens")


def write_tokens(text):
    with open(tokens, "w", encoding="ascii") as file:
        os.chmod(tokens, 0o600)
        file.write(text)


write_tokens(f"studio query,submit {GOOD}\nrobot submit {OTHER}\nslow query {SLOW} 20000\n"
             f"boxes query {BOXES} 20000\n")
daemon = test.daemon("--token-file", tokens)
client = test.client(daemon.grpc_tcp)
request = M.QueryRequest(asset="city", points=bytes(120))


def bearer(token, scheme="Bearer"):
    return (("authorization", f"{scheme} {token}"),)


def reloads():
    """How many times the daemon said that it took new tokens."""
    return daemon.log().count("event=reloaded what=tokens")


def pushback(error):
    return int(dict(error.trailing_metadata())["grpc-retry-pushback-ms"])


def paid(ask):
    """Calls ask() as soon as the rate allows: after a refusal it waits for the retry pushback and
    tries again."""
    deadline = time.monotonic() + 120
    while True:
        try:
            return ask()
        except grpc.RpcError as error:
            assert error.code() == Code.RESOURCE_EXHAUSTED and time.monotonic() < deadline, error
            time.sleep(pushback(error) / 1000)


with test.check("a token with the scope is answered, by whatever call"):
    assert len(client.query(request, timeout=30, metadata=bearer(GOOD)).visibility) == 10
    assert len(client.query(request, timeout=30, metadata=bearer(GOOD, "bearer")).visibility) == 10
    assert len(list(client.stream(iter([request] * 3), timeout=30, metadata=bearer(GOOD)))) == 3
    assert client.list(M.ListRequest(), timeout=30, metadata=bearer(GOOD)).assets
with test.check("no token, an unknown one, or another scheme is UNAUTHENTICATED"):
    for metadata in ((), bearer("x"), bearer(GOOD + "0"), bearer(GOOD[:-1]), bearer(GOOD, "Basic"),
                     (("authorization", "Bearer"),), (("authorization", ""),)):
        for call in (lambda: client.query(request, timeout=30, metadata=metadata),
                     lambda: client.list(M.ListRequest(), timeout=30, metadata=metadata),
                     lambda: list(client.stream(iter([request]), timeout=30, metadata=metadata)),
                     lambda: list(client.reflect[0](iter([R.ServerReflectionRequest(
                         list_services="*")]), timeout=30, metadata=metadata))):
            client.refused(call, Code.UNAUTHENTICATED, "authorization")
    assert daemon.metric("umbrage_unauthorized_total") >= 28
with test.check("a token without the scope is PERMISSION_DENIED and is named"):
    client.refused(lambda: client.query(request, timeout=30, metadata=bearer(OTHER)),
                   Code.PERMISSION_DENIED, "robot", "query")
with test.check("health needs no token"):
    assert client.check(H.HealthCheckRequest(), timeout=30).status == H.HealthCheckResponse.SERVING
with test.check("a token's rate holds; the refusal says when to come again, and that is true"):
    begin = time.monotonic()
    points = M.QueryRequest(asset="city", points=bytes(12 * 10000))
    heavy = M.QueryRequest(asset="city", points=bytes(12 * 60000))  # 3 s of the rate
    for _ in range(5):
        paid(lambda: client.query(points, timeout=30, metadata=bearer(SLOW)))
    elapsed = time.monotonic() - begin
    assert elapsed > 0.9, elapsed  # 20000 points a second and a second ahead: the fifth waits 1 s
    assert len(client.query(request, timeout=30, metadata=bearer(GOOD)).visibility) == 10
with test.check("a box pays for the bricks of its sides, and a token without the scope asks none"):
    Q = test.messages.questions
    boxes = client.unary("/umbrage.v1.Questions/Boxes", Q.BoxesReply)
    huge = Q.BoxesRequest(asset="city", boxes=ut.floats([-1000.0, -1000, -1000, 1000, 1000, 1000] * 100))
    client.refused(lambda: boxes(huge, timeout=30, metadata=bearer(OTHER)), Code.PERMISSION_DENIED)
    assert len(boxes(huge, timeout=30, metadata=bearer(BOXES)).lit) == 800
    client.refused(lambda: client.query(request, timeout=30, metadata=bearer(BOXES)),
                   Code.RESOURCE_EXHAUSTED, "20000")
with test.check("a sample pays for its points, and a token without the scope draws none"):
    sample = client.unary("/umbrage.v1.Shadows/Sample", M.SampleReply)
    drawn = M.SampleRequest(asset="city", count=1000)  # 48384 points of the rate
    client.refused(lambda: sample(drawn, timeout=30, metadata=bearer(OTHER)), Code.PERMISSION_DENIED, "query")
    client.refused(lambda: sample(drawn, timeout=30), Code.UNAUTHENTICATED)
    assert len(paid(lambda: sample(drawn, timeout=30, metadata=bearer(SLOW))).points_f64) == 24000
    begin = time.monotonic()
    paid(lambda: client.query(request, timeout=30, metadata=bearer(SLOW)))
    assert time.monotonic() - begin > 1, "48384 points at 20000 a second, a second ahead"
with test.check("a stream pays for each of its requests"):
    def endless():
        while True:
            yield heavy
    client.refused(lambda: list(client.stream(endless(), timeout=30, metadata=bearer(SLOW))),
                   Code.RESOURCE_EXHAUSTED, "rate")


def open_stream(token):
    """Sends requests on a stream one at a time; returns its status, and the call."""
    feed = queue.Queue()
    replies = client.stream(iter(feed.get, None), timeout=60, metadata=bearer(token))

    def ask(what):
        feed.put(what)
        return next(replies)
    return ask, feed, replies


def begin_stream(token):
    """Opens such a stream, which has answered once."""
    ask, feed, replies = open_stream(token)
    try:
        assert ask(request).visibility
    except grpc.RpcError:
        feed.put(None)
        raise
    return ask, feed


with test.check("a stream pays with its own token, whatever token the connection showed since"):
    ask, feed = paid(lambda: begin_stream(SLOW))
    for other in (GOOD, "unknown-0123456789abcdef"):
        try:
            client.query(request, timeout=30, metadata=bearer(other))
        except grpc.RpcError as error:
            assert error.code() == Code.UNAUTHENTICATED
    client.refused(lambda: [ask(heavy) for _ in range(8)], Code.RESOURCE_EXHAUSTED, "20000")
    feed.put(None)
with test.check("reflection pays for each of its requests"):
    def ask_for_ever():
        while True:
            yield R.ServerReflectionRequest(list_services="*")

    def begin_reflection():
        replies = client.reflect[0](ask_for_ever(), timeout=30, metadata=bearer(SLOW))
        assert next(replies)
        return replies
    replies = paid(begin_reflection)
    client.refused(lambda: list(replies), Code.RESOURCE_EXHAUSTED, "rate")
with test.check("a stream ends when its token is taken away"):
    ask, feed, _ = open_stream(GOOD)
    assert ask(request).visibility
    write_tokens(f"studio query {OTHER}\nslow query {SLOW} 20000\n")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: reloads() == 1, 10, "the reload")
    client.refused(lambda: ask(request), Code.UNAUTHENTICATED, "not known")
    feed.put(None)
    write_tokens(f"studio query,submit {GOOD}\nrobot submit {OTHER}\nslow query {SLOW} 20000\n")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: reloads() == 2, 10, "the reload")
with test.check("a token file with a '#' inside a token is refused, not cut"):
    write_tokens(f"studio query,submit {GOOD}#more\n")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: "'#'" in daemon.log(), 10, "the complaint")
    client.refused(lambda: client.query(request, timeout=30, metadata=bearer(GOOD + "#more")), Code.UNAUTHENTICATED)
    write_tokens(f"studio query,submit {GOOD}\nrobot submit {OTHER}\nslow query {SLOW} 20000\n")
with test.check("SIGHUP takes new tokens at once, on old connections too; a bad file changes nothing"):
    write_tokens(f"studio query {OTHER}\n")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: reloads() == 3, 10, "the reload")
    client.refused(lambda: client.query(request, timeout=30, metadata=bearer(GOOD)),
                   Code.UNAUTHENTICATED)
    assert client.query(request, timeout=30, metadata=bearer(OTHER)).visibility
    write_tokens("nonsense\n")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: daemon.log().count("not_reloaded what=tokens") == 2, 10, "the complaint")
    assert client.query(request, timeout=30, metadata=bearer(OTHER)).visibility
with test.check("a token file that others may read is refused at start"):
    os.chmod(tokens, 0o644)
    done = ut.run("umbraged", "--store", store, "--token-file", tokens, code=77)
    assert b"--token-file" in done.stderr
with test.check("other machines are not listened to without tokens, unless that is asked for"):
    for address in ("tcp:0.0.0.0:0", "tcp:[::]:0"):
        done = ut.run("umbraged", "--store", store, "--listen", address, code=2, timeout=20)
        assert b"--without-tokens" in done.stderr and b"listening" not in done.stderr, done.stderr
client.close()

# --- submissions --------------------------------------------------------------------------------

B = test.messages.bakes
with open(test.scene("box", 2, form="ply"), "rb") as file:
    SCENE = {"box.ply": file.read()}
write_tokens(f"studio query,submit {GOOD}\nrobot submit {OTHER}\nslow query,submit {SLOW} 64\n")
jobs = test.daemon("--token-file", tokens, "--jobs", test.path("jobs"), "--bake-threads", 1)
client = test.client(jobs.grpc_tcp)
reload_count = 0


def reload(text):
    global reload_count
    write_tokens(text)
    jobs.signal(signal.SIGHUP)
    reload_count += 1
    ut.wait_until(lambda: jobs.log().count("event=reloaded what=tokens") == reload_count, 10, "the reload")


def begin_upload(token):
    """An upload that has sent its manifest and half of its file; how to go on, and the call."""
    feed = queue.Queue()
    call = client.raw_submit.future(iter(feed.get, None), timeout=60, metadata=bearer(token))
    data = SCENE["box.ply"]
    feed.put(B.SubmitRequest(manifest=client.manifest(SCENE, "box.ply", resolution=64)))
    feed.put(B.SubmitRequest(data=data[:100]))
    incoming = test.path("jobs", "incoming")
    ut.wait_until(lambda: os.path.isdir(incoming) and os.listdir(incoming), 20, "the upload has begun")

    def go_on(more=True):
        if more:
            feed.put(B.SubmitRequest(data=data[100:]))
        feed.put(None)
    return go_on, call


with test.check("Submit pays its token's rate, whatever it says, and for all its files before they come"):
    empty = [lambda: iter([B.SubmitRequest(manifest=B.Manifest(scene="x"))]), lambda: iter([]),
             lambda: iter([B.SubmitRequest(data=b"x")])]
    for what in empty:
        codes = []
        while codes[-1:] != [Code.RESOURCE_EXHAUSTED] and len(codes) < 50:  # one a second is paid for
            try:
                client.raw_submit(what(), timeout=30, metadata=bearer(SLOW))
            except grpc.RpcError as error:
                codes.append(error.code())
        assert set(codes) <= {Code.INVALID_ARGUMENT, Code.RESOURCE_EXHAUSTED}, codes
        assert codes[-1] == Code.RESOURCE_EXHAUSTED, codes
    vast = B.Manifest(scene="box.ply")  # refused whatever its rate: it pays for the call alone
    vast.files.add(path="box.ply", size=1 << 60, sha256=bytes(32))
    deadline, said = time.monotonic() + 60, ""
    while "--max-bundle" not in said and time.monotonic() < deadline:
        try:
            client.raw_submit(iter([B.SubmitRequest(manifest=vast)]), timeout=30, metadata=bearer(SLOW))
        except grpc.RpcError as error:
            said = error.details()
            time.sleep(pushback(error) / 1000 if "rate" in said else 0)
    assert "--max-bundle" in said, said
    huge = B.Manifest(scene="box.ply")  # a mebibyte is 87381 points: 1365 s of that rate
    huge.files.add(path="box.ply", size=1 << 20, sha256=bytes(32))
    deadline, answer = time.monotonic() + 60, None
    while answer != Code.INVALID_ARGUMENT and time.monotonic() < deadline:  # its data does not come
        try:
            client.raw_submit(iter([B.SubmitRequest(manifest=huge)]), timeout=30, metadata=bearer(SLOW))
        except grpc.RpcError as error:
            answer = error.code()
            time.sleep(pushback(error) / 1000 if answer == Code.RESOURCE_EXHAUSTED else 0)
    assert answer == Code.INVALID_ARGUMENT, answer
    try:
        client.raw_submit(empty[0](), timeout=30, metadata=bearer(SLOW))
        raise AssertionError("it was not refused")
    except grpc.RpcError as error:
        assert error.code() == Code.RESOURCE_EXHAUSTED and pushback(error) > 600000, error
with test.check("a submission whose job exists pays for the call alone"):
    reload(f"studio query,submit {GOOD} 6400\nrobot submit {OTHER}\n")
    large = {**SCENE, "notes.txt": bytes(12 * 12800)}  # two seconds of that rate
    first = client.submit(large, "box.ply", metadata=bearer(GOOD), resolution=64, verify=1000)
    assert not first.existing
    time.sleep(2.5)
    for _ in range(20):  # with its files each would take two seconds
        again = iter([B.SubmitRequest(manifest=client.manifest(large, "box.ply", resolution=64, verify=1000))])
        reply = client.raw_submit(again, timeout=30, metadata=bearer(GOOD))
        assert reply.existing and reply.job == first.job, reply
    reload(f"studio query,submit {GOOD}\nrobot submit {OTHER}\n")
submitted = jobs.metric("umbrage_jobs_submitted_total")
with test.check("a token taken back in mid-upload gets no job, whether at a piece or at the end"):
    for more in (True, False):
        go_on, call = begin_upload(OTHER)
        reload(f"studio query,submit {GOOD}\n")
        go_on(more)
        client.refused(call.result, Code.UNAUTHENTICATED)
        reload(f"studio query,submit {GOOD}\nrobot submit {OTHER}\n")
    go_on, call = begin_upload(OTHER)  # it has another owner's name now
    reload(f"studio query,submit {GOOD}\nother submit {OTHER}\n")
    go_on()
    client.refused(call.result, Code.PERMISSION_DENIED, "robot", "other")
    reload(f"studio query,submit {GOOD}\nrobot submit {OTHER}\n")
    assert jobs.metric("umbrage_jobs_submitted_total") == submitted
    assert not list(client.list_jobs(B.ListJobsRequest(), timeout=30, metadata=bearer(OTHER)).jobs)
jobs.stop()
client.close()
with test.check("a Watch of a job tells no more when its token is taken back"):
    program, gate = test.held_bakes()
    with open(gate, "w", encoding="ascii"):
        pass
    write_tokens(f"root submit,admin {GOOD}\nrobot submit {OTHER}\n")
    jobs = test.daemon("--token-file", tokens, "--jobs", test.path("jobs2"), "--bake-threads", 1,
                       "--bake-program", program)
    client = test.client(jobs.grpc_tcp)
    job = client.submit(SCENE, "box.ply", metadata=bearer(OTHER), resolution=64, verify=1000).job
    watching = client.watch_job(B.WatchRequest(job=job), timeout=60, metadata=bearer(OTHER))
    while next(watching).state != B.JOB_RUNNING:
        pass
    reload_count = 0
    reload(f"root submit,admin {GOOD}\n")
    client.cancel_job(B.CancelRequest(job=job), timeout=30, metadata=bearer(GOOD))
    told = []
    client.refused(lambda: told.extend(watching), Code.UNAUTHENTICATED)
    assert not [status for status in told if status.state != B.JOB_RUNNING], told
    jobs.stop()
    client.close()

limited = test.daemon("--address-rate", 20, "--max-address-connections", 3)
with test.check("an address has its rate, whatever connection it asks on"):
    clients = [test.client(limited.grpc_tcp) for _ in range(2)]
    codes = []  # the first batch passes and is paid for after 500 s
    for i in range(8):
        try:
            clients[i % 2].query(points, timeout=30)
            codes.append(Code.OK)
        except grpc.RpcError as error:
            codes.append(error.code())
            assert pushback(error) > 0
    assert codes == [Code.OK] + [Code.RESOURCE_EXHAUSTED] * 7, codes
    assert limited.metric("umbrage_rate_limited_total") == 7
    unix = test.client(limited.grpc_unix)
    assert unix.query(points, timeout=30).visibility  # another account
    unix.close()
with test.check("a first budget is answered, though its calibration is paid for at a small rate"):
    small = test.daemon("--address-rate", 10000)
    one = test.client(small.grpc_tcp)
    budget = M.QueryRequest(asset="city", points=bytes(120), budget_ns=100000.0)
    assert len(one.query(budget, timeout=60).visibility) == 10
    one.refused(lambda: one.query(budget, timeout=60), Code.RESOURCE_EXHAUSTED, "rate")
    one.close()
    small.stop()
with test.check("who comes again when he was told to is answered, whatever he asks for: a call pays once"):
    G = test.messages.regions
    small = test.daemon("--address-rate", 40)  # a call costs more than the second that one may be ahead
    one = test.client(small.grpc_tcp)
    segments = one.unary("/umbrage.v1.Questions/Segments", Q.SegmentsReply)
    served = [one.channel.unary_stream(f"/umbrage.v1.Regions/{name}",
                                       response_deserializer=G.RegionReply.FromString,
                                       request_serializer=lambda message: message.SerializeToString())
              for name in ("Stream", "DeriveMap")]
    for ask in (lambda: segments(Q.SegmentsRequest(asset="city", segments=bytes(24)), timeout=30),
                lambda: list(served[0](G.RegionRequest(asset="city", offsets=[0], lengths=[16]), timeout=30)),
                lambda: list(served[1](G.DeriveMapRequest(asset="city", width=1, height=1), timeout=30))):
        for attempt in range(3):
            try:
                assert ask()
                break
            except grpc.RpcError as error:
                assert error.code() == Code.RESOURCE_EXHAUSTED and attempt < 1, (attempt, error.details())
                assert pushback(error) < 4000, pushback(error)
                time.sleep(pushback(error) / 1000)
    one.close()
    small.stop()
with test.check("an address may have so many connections and no more; one that only asked health makes room"):
    clients += [test.client(limited.grpc_tcp) for _ in range(3)]
    answers = []
    for one in clients[2:4]:  # the third, whose place the fourth takes
        one.check(H.HealthCheckRequest(), timeout=60)
    assert limited.metric("umbrage_connections_evicted_total") == 1
    for one in clients[3:]:  # the debts of the address do not matter here, but the call was allowed
        try:
            one.query(request, timeout=60)
        except grpc.RpcError as error:
            answers.append(error.code())
    assert answers == [Code.RESOURCE_EXHAUSTED, Code.UNAVAILABLE], answers
    assert limited.metric("umbrage_connections_refused_total") >= 1
for one in clients:
    one.close()
test.finish()
