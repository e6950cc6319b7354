#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Messages of the bake service that come in the wrong order, are too many or too few, or are
cancelled: each must be refused by name and leave nothing below the jobs folder, and the next
submission must work. Fetches of large assets, from every offset, slowly, and by owners who lose
their token meanwhile.
"""
import os
import signal
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
B = test.messages.bakes
JOBS, TOKENS = test.path("jobs"), test.path("tokens")
ANN = [("authorization", "Bearer ann-0123456789abcdef")]
BOB = [("authorization", "Bearer bob-0123456789abcdef")]


def write_tokens(**names):
    with open(os.open(TOKENS + ".new", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w",
              encoding="ascii") as file:
        for name, scopes in names.items():
            file.write(f"{name} {scopes} {name}-0123456789abcdef\n")
    os.rename(TOKENS + ".new", TOKENS)


write_tokens(ann="query,submit", bob="query,submit")
daemon = test.daemon("--jobs", JOBS, "--token-file", TOKENS, "--bake-threads", 1, "--max-bundle",
                     "8MiB", "--owner-bytes", "16MiB")
client = test.client(daemon.grpc_unix)
with open(test.scene("forest", 60), "rb") as file:
    scene = file.read()
FILES = {"scene.glb": scene}
MANIFEST = B.SubmitRequest(manifest=client.manifest(FILES, "scene.glb", resolution=4096,
                                                    closed="off"))


def data(piece):
    return B.SubmitRequest(data=piece)


def submit(*messages, who=ANN):
    return client.raw_submit(iter(messages), timeout=60, metadata=who)


def leftovers():
    return [name for folder in ("incoming", "bundles")
            for name in os.listdir(os.path.join(JOBS, folder))]


def nothing_is_left():
    ut.wait_until(lambda: not leftovers(), 10, "the uploads to be removed")


with test.check("a submission without a manifest, or with data before it, is refused"):
    client.refused(submit, Code.INVALID_ARGUMENT, "manifest")
    client.refused(lambda: submit(data(scene)), Code.INVALID_ARGUMENT, "manifest",
                   "first message")
    client.refused(lambda: submit(B.SubmitRequest()), Code.INVALID_ARGUMENT, "manifest")
    assert not leftovers()

with test.check("a second manifest is refused, and the upload goes"):
    client.refused(lambda: submit(MANIFEST, data(scene[:1000]), MANIFEST), Code.INVALID_ARGUMENT,
                   "manifest: there was one already")
    nothing_is_left()

with test.check("too few bytes, too many, and other bytes are refused, and the upload goes"):
    client.refused(lambda: submit(MANIFEST, data(scene[:-1])), Code.INVALID_ARGUMENT)
    client.refused(lambda: submit(MANIFEST), Code.INVALID_ARGUMENT)
    client.refused(lambda: submit(MANIFEST, data(scene + b"x")), Code.INVALID_ARGUMENT)
    client.refused(lambda: submit(MANIFEST, data(scene[:-1] + b"x")), Code.INVALID_ARGUMENT)
    client.refused(lambda: submit(B.SubmitRequest(manifest=client.manifest(
        {"scene.glb": b"x" * (8 << 20) + b"x"}, "scene.glb"))), (Code.INVALID_ARGUMENT,
                                                            Code.RESOURCE_EXHAUSTED))
    nothing_is_left()

with test.check("sizes that add up to more than 2^64 are refused"):
    manifest = client.manifest(FILES, "scene.glb")
    for name in ("a", "b", "c"):
        manifest.files.add(path=name, size=(1 << 64) - 1, sha256=bytes(32))
    client.refused(lambda: submit(B.SubmitRequest(manifest=manifest)),
                   (Code.INVALID_ARGUMENT, Code.RESOURCE_EXHAUSTED))

with test.check("a submission that is cancelled at any point leaves nothing"):
    for count in range(4):
        gone = threading.Event()

        def messages():
            yield MANIFEST
            for i in range(count):
                yield data(scene[i * 1000:(i + 1) * 1000])
            gone.wait(30)
        call = client.raw_submit.future(messages(), timeout=60, metadata=ANN)
        time.sleep(0.05)
        call.cancel()
        gone.set()
    nothing_is_left()

with test.check("empty pieces are pieces, and the job is done"):
    reply = submit(MANIFEST, data(b""), *[data(scene[at:at + 50000])
                                          for at in range(0, len(scene), 50000)], data(b""))
    status = client.finished_job(reply.job, metadata=ANN, timeout=240)
    assert status.state == B.JOB_DONE, status
    asset = status.asset.hex()
with open(os.path.join(JOBS, "assets", asset + ".umb"), "rb") as file:
    whole = file.read()


def fetch(offset=0, who=ANN, name=None):
    replies = client.fetch(B.FetchRequest(asset=name or asset, offset=offset), timeout=60,
                           metadata=who)
    at, got = offset, b""
    for reply in replies:
        assert reply.size == len(whole) and reply.offset == at
        at += len(reply.data)
        got += reply.data
    return got


with test.check("an asset is fetched from every offset, its end included, and not from behind it"):
    assert len(whole) > 1 << 19, "several pieces are wanted"
    for offset in (0, 1, 4096, len(whole) // 2, len(whole) - 1, len(whole)):
        assert fetch(offset) == whole[offset:], offset
    for offset in (len(whole) + 1, (1 << 64) - 1):
        client.refused(lambda: fetch(offset), Code.INVALID_ARGUMENT, "offset",
                       str(len(whole)))

with test.check("ids that are none, unknown and of another owner are refused by every call"):
    for name in ("", "city", asset[:-1], asset + "0", "g" * 64, "../" + asset):
        client.refused(lambda: fetch(name=name or "-"), Code.INVALID_ARGUMENT, "asset")
        client.refused(lambda: client.delete_asset(B.DeleteRequest(asset=name), timeout=60,
                                                   metadata=ANN), Code.INVALID_ARGUMENT, "asset")
    for who, name in ((ANN, "0" * 64), (BOB, asset)):
        client.refused(lambda: fetch(who=who, name=name), Code.NOT_FOUND)
        client.refused(lambda: client.delete_asset(B.DeleteRequest(asset=name), timeout=60,
                                                   metadata=who), Code.NOT_FOUND)
    for job in ("", "x", "0" * 32, "a/../b", "j" * 500):
        refused = (Code.NOT_FOUND, Code.INVALID_ARGUMENT)
        client.refused(lambda: client.cancel_job(B.CancelRequest(job=job), timeout=60,
                                                 metadata=ANN), refused, "job")
        client.refused(lambda: client.finished_job(job, metadata=ANN), refused, "job")
    for call in (lambda: client.cancel_job(B.CancelRequest(job=reply.job), timeout=60,
                                           metadata=BOB),
                 lambda: client.finished_job(reply.job, metadata=BOB)):
        client.refused(call, Code.NOT_FOUND)

with test.check("lists are as long as they are asked to be"):
    assert len(client.list_jobs(B.ListJobsRequest(), timeout=60, metadata=ANN).jobs) == 1
    assert len(client.list_jobs(B.ListJobsRequest(limit=1), timeout=60, metadata=ANN).jobs) == 1
    assert len(client.list_jobs(B.ListJobsRequest(), timeout=60, metadata=BOB).jobs) == 0

with test.check("a slow reader gets all pieces; one that leaves does no harm"):
    slow = test.client(daemon.grpc_unix, [("grpc.http2.lookahead_bytes", 1024),
                                          ("grpc.http2.max_frame_size", 16384)])
    got = b""
    for piece in slow.fetch(B.FetchRequest(asset=asset), timeout=60, metadata=ANN):
        got += piece.data
        time.sleep(0.01)
    assert got == whole
    left = slow.fetch(B.FetchRequest(asset=asset), timeout=60, metadata=ANN)
    next(left)
    left.cancel()
    slow.close()
    assert fetch() == whole

with test.check("a fetch whose file went, or is a folder, is refused"):
    path = os.path.join(JOBS, "assets", asset + ".umb")
    os.rename(path, path + ".kept")
    try:
        client.refused(fetch, Code.NOT_FOUND, "asset")
        os.mkdir(path)
        client.refused(fetch, (Code.INTERNAL, Code.NOT_FOUND, Code.UNKNOWN, Code.DATA_LOSS), "asset")
        os.rmdir(path)
    finally:
        os.rename(path + ".kept", path)
    assert fetch() == whole

with test.check("an owner whose token is taken back loses the upload"):
    stop = threading.Event()

    def slowly():
        yield B.SubmitRequest(manifest=client.manifest(FILES, "scene.glb", resolution=512))
        yield data(scene[:1000])
        stop.wait(60)
        yield data(scene[1000:2000])
        time.sleep(0.2)
        yield data(scene[2000:])
    upload = client.raw_submit.future(slowly(), timeout=60, metadata=BOB)
    ut.wait_until(leftovers, 10, "the upload to begin")
    write_tokens(ann="query,submit")
    daemon.signal(signal.SIGHUP)
    ut.wait_until(lambda: "what=tokens" in daemon.log(), 10, "the new tokens")
    stop.set()
    client.refused(upload.result, (Code.UNAUTHENTICATED, Code.PERMISSION_DENIED))
    nothing_is_left()

with test.check("a deleted asset is gone"):
    client.delete_asset(B.DeleteRequest(asset=asset), timeout=60, metadata=ANN)
    client.refused(fetch, Code.NOT_FOUND)

client.close()
daemon.stop()

with test.check("an upload of a byte now and then is ended, a steady one is not"):
    daemon = test.daemon("--jobs", JOBS, "--bake-threads", 1, "--idle-timeout", "1s",
                         "--body-timeout", "1s")
    client = test.client(daemon.grpc_unix)
    SIZES = {"a byte": (1, 200, Code.DEADLINE_EXCEEDED),  # 10 bytes a second
             "steady": (1 << 16, 40, Code.INVALID_ARGUMENT)}  # to its end: the hash is wrong
    for name, (size, count, code) in SIZES.items():
        manifest = client.manifest({"scene.glb": bytes(size * count)}, "scene.glb", resolution=512)
        manifest.files[0].sha256 = bytes(32)

        def pieces():
            yield B.SubmitRequest(manifest=manifest)
            for _ in range(count):
                time.sleep(0.1)
                yield data(bytes(size))
        client.refused(lambda: client.raw_submit(pieces(), timeout=60), code)
    ut.wait_until(lambda: not leftovers(), 10, "the uploads to be removed")
    client.close()

test.finish()
