#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Regions.Stream and Follow with a foreign client (python3-grpcio): the bytes must be those of the
packed file, every refusal must name the field, and the client must be told of a replaced file.
"""
import os
import queue
import shutil
import signal
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
store = test.path("store")
os.mkdir(store)
city = store + "/city.umb"
baked = test.bake(test.scene("city", 8), city, "--resolution", 2048, "--verify", 0)
daemon = test.daemon("--workers", 2)
channel = grpc.insecure_channel(daemon.grpc_unix)
M = test.messages.regions
codec = {"request_serializer": M.RegionRequest.SerializeToString,
         "response_deserializer": M.RegionReply.FromString}
stream = channel.unary_stream("/umbrage.v1.Regions/Stream", **codec)
follow = channel.stream_stream("/umbrage.v1.Regions/Follow", **codec)
with open(city, "rb") as file:
    whole = file.read()


def ask(*stretches, asset="city"):
    return M.RegionRequest(asset=asset, offsets=[s[0] for s in stretches],
                           lengths=[s[1] for s in stretches])


def refused(code, words, request, or_code=None):
    try:
        list(stream(request, timeout=60))
    except grpc.RpcError as error:
        assert error.code() in (code, or_code), (error.code(), error.details())
        assert error.code() == or_code or words in error.details(), error.details()
        return
    raise AssertionError(f"answered: {request}")


with test.check("stretches come as they stand in the file, in the order asked for"):
    reply, = stream(ask((0, 500), (len(whole) - 100, 100), (1000, 77)), timeout=60)
    assert reply.data == whole[:500] + whole[-100:] + whole[1000:1077]
    assert reply.file_bytes == len(whole)
    assert reply.asset_id.hex() == baked["asset"]
    reply, = stream(ask((0, 500), asset=baked["asset"]), timeout=60)
    assert reply.data == whole[:500]

with test.check("the file's end cuts a stretch"):
    reply, = stream(ask((len(whole) - 10, 100)), timeout=60)
    assert reply.data == whole[-10:]
    reply, = stream(ask((len(whole) + 5, 100)), timeout=60)
    assert reply.data == b""

with test.check("a followed camera gets a reply for each request, in order, the whole file in pieces"):
    pieces = [(at, 3000) for at in range(0, len(whole), 3000)]
    replies = [r.data for r in follow(iter([ask(piece) for piece in pieces]), timeout=120)]
    assert b"".join(replies) == whole, (len(replies), len(pieces))

with test.check("when the camera moves, what is asked then comes next, and of the old view nothing more"):
    asked, waiting = queue.Queue(), [(at, 3000) for at in range(0, len(whole) // 2, 3000)]
    replies = follow(iter(asked.get, None), timeout=120)
    for piece in waiting[:3]:
        asked.put(ask(piece))
        assert next(replies).data == whole[piece[0]:piece[0] + piece[1]]
    moved = [(len(whole) - 3000 * i, 3000) for i in (1, 2, 3)]
    for piece in moved:
        asked.put(ask(piece))
    asked.put(None)
    assert [r.data for r in replies] == [whole[at:at + size] for at, size in moved]

with test.check("what cannot be is refused with the field's name"):
    refused(Code.NOT_FOUND, "nope", ask((0, 1), asset="nope"))
    refused(Code.INVALID_ARGUMENT, "asset", ask((0, 1), asset=""))
    refused(Code.INVALID_ARGUMENT, "offsets", ask())
    refused(Code.INVALID_ARGUMENT, "offsets", ask(*[(i, 1) for i in range(129)]))
    refused(Code.INVALID_ARGUMENT, "lengths[0]", ask((0, 0)))
    refused(Code.INVALID_ARGUMENT, "lengths[1]", ask((0, 1 << 20), (0, 1)))
    refused(Code.INVALID_ARGUMENT, "lengths[0]", ask(((1 << 64) - 1, 1)))
    refused(Code.INVALID_ARGUMENT, "as many", M.RegionRequest(asset="city", offsets=[1]))

with test.check("128 stretches of the greatest length that fits are answered"):
    reply, = stream(ask(*[(i * 7, 8192) for i in range(128)]), timeout=60)
    assert reply.data == b"".join(whole[i * 7:i * 7 + 8192] for i in range(128))

with test.check("a cancelled call leaves the server well"):
    for _ in range(20):
        call = follow(iter([ask((0, 1 << 20))] * 8), timeout=60)
        next(call)
        call.cancel()
    reply, = stream(ask((0, 8)), timeout=60)
    assert reply.data == whole[:8]

with test.check("the client of the library streams from the daemon what it streams from the file"):
    one, other = test.path("one.part"), test.path("other.part")
    view = ["--camera", "eye=1,1.7,1,target=100,1.7,9,fov=60,far=40", "--quiet"]
    ut.run("umbrage", "stream", "city", "--address", daemon.grpc_unix, *view, "-o", one)
    ut.run("umbrage", "stream", city, *view, "-o", other)
    with open(one, "rb") as a, open(other, "rb") as b:
        assert a.read() == b.read()



def version_watch(channel, asset, metadata=()):
    """Regions.Watch, as an iterator of replies."""
    return channel.unary_stream("/umbrage.v1.Regions/Watch", request_serializer=lambda m: m.SerializeToString(),
                                response_deserializer=M.RegionReply.FromString)(
        M.VersionRequest(asset=asset), timeout=60, metadata=metadata)


def ends(watching, code):
    """Expects a watch to end with a code; returns its message."""
    try:
        told = list(watching)
    except grpc.RpcError as error:
        assert error.code() == code, (error.code(), error.details())
        return error.details()
    raise AssertionError(f"ended well: {told}")


with test.check("a watch names the version at once, each new one, and that the asset is gone"):
    many = [version_watch(channel, "city") for _ in range(20)]
    for watching in many:
        first = next(watching)
        assert first.asset_id.hex() == baked["asset"] and first.file_bytes == len(whole) and first.data == b""
    for watching in many[1:]:
        watching.cancel()
    by_id = version_watch(channel, baked["asset"])
    assert next(by_id).asset_id.hex() == baked["asset"]
    later = test.bake(test.scene("city", 8, 2), test.path("later.umb"), "--resolution", 256, "--verify", 0)
    shutil.copyfile(city, test.path("first.umb"))
    os.replace(test.path("later.umb"), city)
    assert next(many[0]).asset_id.hex() == later["asset"]
    ends(by_id, Code.NOT_FOUND)
    os.replace(test.path("first.umb"), city)
    assert next(many[0]).asset_id.hex() == baked["asset"]
    shutil.move(city, city + ".away")
    assert "city" in ends(many[0], Code.NOT_FOUND)
    ends(version_watch(channel, "city"), Code.NOT_FOUND)
    ends(version_watch(channel, ""), Code.INVALID_ARGUMENT)
    ends(version_watch(channel, "x" * 300), Code.INVALID_ARGUMENT)
    shutil.move(city + ".away", city)

with test.check("a watch sees what its caller may see, while it may; a drain ends it"):
    tokens = test.path("tokens")
    OWNER, OTHER, NO_QUERY = "owner-0123456789abcdef", "other-0123456789abcdef", "plain-0123456789abcdef"

    def write_tokens(text):
        with open(os.open(tokens, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="ascii") as file:
            file.write(text)

    def bearer(token):
        return (("authorization", f"Bearer {token}"),)

    write_tokens(f"owner query,submit {OWNER}\nother query {OTHER}\nplain submit {NO_QUERY}\n")
    guarded = test.daemon("--token-file", tokens, "--jobs", test.path("jobs"), store=test.path("guarded"))
    client = test.client(guarded.grpc_unix)
    with open(test.scene("city", 2), "rb") as file:
        job = client.submit({"city.glb": file.read()}, "city.glb", metadata=bearer(OWNER), resolution=64, verify=1000)
    asset = client.finished_job(job.job, metadata=bearer(OWNER)).asset.hex()
    own = version_watch(client.channel, asset, bearer(OWNER))
    assert next(own).asset_id.hex() == asset
    unseen = ends(version_watch(client.channel, asset, bearer(OTHER)), Code.NOT_FOUND)
    missing = ends(version_watch(client.channel, "ab" * 32, bearer(OTHER)), Code.NOT_FOUND)
    assert unseen.replace(asset, "") == missing.replace("ab" * 32, ""), (unseen, missing)
    ends(version_watch(client.channel, asset, bearer(NO_QUERY)), Code.PERMISSION_DENIED)
    ends(version_watch(client.channel, asset), Code.UNAUTHENTICATED)
    write_tokens(f"other query {OTHER}\n")
    guarded.signal(signal.SIGHUP)
    ends(own, Code.UNAUTHENTICATED)
    shutil.copyfile(city, test.path("guarded", "city.umb"))
    ut.wait_until(lambda: "city" in [x.name for x in client.list(
        test.messages.shadows.ListRequest(), timeout=30, metadata=bearer(OTHER)).assets], 30, "the asset")
    last = version_watch(client.channel, "city", bearer(OTHER))
    next(last)
    guarded.signal(signal.SIGTERM)
    ends(last, Code.UNAVAILABLE)
    client.close()
    guarded.exited()

with test.check("a file that was replaced behind the server's back is told"):
    shutil.move(city, city + ".away")
    refused(Code.FAILED_PRECONDITION, "gone", ask((0, 1), asset=baked["asset"]),
            or_code=Code.NOT_FOUND)  # once the store has seen it go
    shutil.move(city + ".away", city)

test.finish()
