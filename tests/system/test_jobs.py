#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The bake service with real processes: a submission must become the asset that the command line
makes, once, whatever process is killed. Owners must see only their own jobs, and refusals of
hostile bundles must state the reason.
"""
import json
import os
import signal
import struct
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
B = test.messages.bakes
STORE, JOBS = test.path("store"), test.path("jobs")
ASSETS = os.path.join(JOBS, "assets")
TOKENS = test.path("tokens")
WHO = {name: [("authorization", f"Bearer {name}-0123456789abcdef")]
       for name in ("ann", "bob", "eve", "boss")}
with open(os.open(TOKENS, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
    for name, scopes in (("ann", "query,submit"), ("bob", "query,submit"), ("eve", "query"),
                         ("boss", "query,submit,admin")):
        file.write(f"{name} {scopes} {name}-0123456789abcdef\n")


HELD_BAKE, HOLD = test.held_bakes()


def start(*options):
    daemon = test.daemon("--jobs", JOBS, "--token-file", TOKENS, "--bake-threads", 1, "--bake-program",
                         HELD_BAKE, *options)
    return daemon, test.client(daemon.grpc_tcp)


def read(path):
    with open(path, "rb") as file:
        return file.read()


def workers(daemon):
    """Processes that the daemon's bakes are, and their importers."""
    done = subprocess.run(["pgrep", "-f", f"^{ut.program('umbrage-bake')} .*{JOBS}"],
                          stdout=subprocess.PIPE, check=False)
    return [int(word) for word in done.stdout.split()]


def leftovers():
    """What a finished job must not leave."""
    found = []
    for folder in ("incoming", "bundles", "work"):
        found += [f"{folder}/{name}" for name in os.listdir(os.path.join(JOBS, folder))]
    return found + [name for name in os.listdir(STORE) if name.startswith(".tmp.")]


scene = read(test.scene("city", 4))
plain = test.bake(test.scene("city", 4), test.path("plain.umb"), "--resolution", 512, "--sun",
                  "120,40", "--verify", 20000)["asset"]
daemon, client = start()

with test.check("a submitted scene becomes the asset of the command line, and is served"):
    reply = client.submit({"a/city.glb": scene}, "a/city.glb", WHO["ann"], resolution=512,
                          sun="120,40", verify=20000)
    assert not reply.existing
    seen = list(client.watch_job(B.WatchRequest(job=reply.job), metadata=WHO["ann"], timeout=60))
    status = seen[-1]
    assert status.state == B.JOB_DONE, status
    assert status.asset.hex() == plain, f"{status.asset.hex()} is not {plain}"
    assert "effect=closed" in status.plan, status.plan
    assert read(os.path.join(ASSETS, plain + ".umb"))
    answer = client.query(test.messages.shadows.QueryRequest(asset=plain,
                                                             points=ut.floats([0, 0, 0])),
                          metadata=WHO["ann"], timeout=60)
    assert answer.asset_id.hex() == plain
    assert leftovers() == [], leftovers()

with test.check("the same of the same owner is the same job, at once and without its data"):
    manifest = client.manifest({"a/city.glb": scene}, "a/city.glb", resolution=512, sun="120,40",
                               verify=20000)

    def only_manifest():
        yield B.SubmitRequest(manifest=manifest)
        time.sleep(30)

    begin = time.monotonic()
    again = client.raw_submit(only_manifest(), timeout=20, metadata=WHO["ann"])
    assert again.existing and again.job == reply.job and time.monotonic() - begin < 10

with test.check("another owner of the same scene learns nothing, and the asset is kept once"):
    other = client.submit({"a/city.glb": scene}, "a/city.glb", WHO["bob"], resolution=512,
                          sun="120,40", verify=20000)
    assert not other.existing and other.job != reply.job
    status = client.finished_job(other.job, WHO["bob"])
    assert status.asset.hex() == plain
    tiles = (status.tiles_total, status.tiles_done, status.tiles_found)
    assert status.tiles_done > 0 and tiles == (status.tiles_done, status.tiles_done, 0), tiles
    assert daemon.metric('umbrage_job_tiles_total') == 2 * status.tiles_done, "it was not baked"
    shown = list(client.watch_job(B.WatchRequest(job=other.job), metadata=WHO["bob"], timeout=60))
    assert "effect=closed" in shown[-1].plan, "a job without a plan is one that somebody else had"
    assert [job.job for job in client.list_jobs(B.ListJobsRequest(), metadata=WHO["bob"]).jobs] \
        == [other.job]
    for call in (lambda: client.cancel_job(B.CancelRequest(job=reply.job), metadata=WHO["bob"]),
                 lambda: list(client.watch_job(B.WatchRequest(job=reply.job), timeout=60,
                                               metadata=WHO["bob"]))):
        client.refused(call, Code.NOT_FOUND)

with test.check("only owners and admins see an asset that a job made, in health too"):
    S = test.messages.shadows
    H = test.messages.health

    R = test.messages.regions
    region = client.channel.unary_stream("/umbrage.v1.Regions/Stream",
                                         request_serializer=R.RegionRequest.SerializeToString,
                                         response_deserializer=R.RegionReply.FromString)

    def asked(who, name=plain):
        part = R.RegionRequest(asset=name, offsets=[0], lengths=[8])
        requests = (lambda: client.query(S.QueryRequest(asset=name, points=ut.floats([0, 0, 0])),
                                         metadata=who, timeout=60),
                    lambda: client.describe(S.DescribeRequest(asset=name), metadata=who, timeout=60),
                    lambda: list(region(part, metadata=who, timeout=60)))
        found = []
        for request in requests:
            try:
                request()
                found.append(None)
            except grpc.RpcError as error:
                assert error.code() == Code.NOT_FOUND, error
                found.append(error.details().replace(name, "X"))
        listed = [a.name for a in client.list(S.ListRequest(), metadata=who, timeout=60).assets]
        return found, name in listed

    for name in ("ann", "bob", "boss"):
        assert asked(WHO[name]) == ([None, None, None], True), name
    nothing = asked(WHO["eve"], 64 * "0")
    assert asked(WHO["eve"]) == nothing and nothing[1] is False, asked(WHO["eve"])
    service = "umbrage.v1.Shadows/" + plain
    client.refused(lambda: client.check(H.HealthCheckRequest(service=service), timeout=60),
                   Code.NOT_FOUND)
    assert client.check(H.HealthCheckRequest(service=service), metadata=WHO["ann"],
                        timeout=60).status == 1

with test.check("an asset is fetched whole, and from an offset on"):
    whole = read(os.path.join(ASSETS, plain + ".umb"))
    for offset in (0, 1, len(whole) - 1, len(whole)):
        pieces = list(client.fetch(B.FetchRequest(asset=plain, offset=offset), timeout=20,
                                   metadata=WHO["ann"]))
        assert b"".join(piece.data for piece in pieces) == whole[offset:]
        assert pieces[0].size == len(whole)
    client.refused(lambda: list(client.fetch(B.FetchRequest(asset=plain, offset=len(whole) + 1),
                                             timeout=20, metadata=WHO["ann"])),
                   Code.INVALID_ARGUMENT, "offset")

with test.check("who may not submit is told so"):
    client.refused(lambda: client.submit({"a.glb": scene}, "a.glb"), Code.UNAUTHENTICATED)
    client.refused(lambda: client.submit({"a.glb": scene}, "a.glb", WHO["eve"]),
                   Code.PERMISSION_DENIED, "submit")

with test.check("manifests that lie or climb are INVALID_ARGUMENT and name the field"):
    for path in ("../a.glb", "/a.glb", "a/../../a.glb", "a//b.glb", "./a.glb", "a\\b.glb", ""):
        client.refused(lambda path=path: client.submit({path: scene}, path, WHO["ann"]),
                       Code.INVALID_ARGUMENT, "files[0].path")
    for settings, word in (({"output": "/tmp/x"}, "output"), ({"resolution": ""}, "resolution"),
                           ({"memory": "1GiB"}, "memory"), ({"progress_fd": "1"}, "progress-fd")):
        client.refused(lambda s=settings: client.submit({"a.glb": scene}, "a.glb", WHO["ann"], **s),
                       Code.INVALID_ARGUMENT, word)
    client.refused(lambda: client.submit({"a.fbx": scene}, "a.fbx", WHO["ann"]),
                   Code.INVALID_ARGUMENT, "scene")
    client.refused(lambda: client.submit({"a": b"x", "a/b.glb": scene}, "a/b.glb", WHO["ann"]),
                   Code.INVALID_ARGUMENT, "files[1].path")
    manifest = client.manifest({"a.glb": scene}, "a.glb", resolution=64)
    for data, word in ((scene[:-1], "ended"), (scene + b"x", "more"),
                       (scene[:-1] + bytes([scene[-1] ^ 1]), "sha256")):
        client.refused(lambda d=data: client.raw_submit(
            iter([B.SubmitRequest(manifest=manifest), B.SubmitRequest(data=d)]), timeout=20,
            metadata=WHO["ann"]), Code.INVALID_ARGUMENT, word)
    client.refused(lambda: client.raw_submit(iter([B.SubmitRequest(data=b"x")]), timeout=20,
                                             metadata=WHO["ann"]), Code.INVALID_ARGUMENT, "manifest")
    ut.wait_until(lambda: leftovers() == [], 10, "uploads are removed")


def gltf(**changes):
    """A triangle with its buffer in the file, or a hostile version of it."""
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"uri": "a.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                       "min": [0, 0, 0], "max": [1, 1, 1]}]}
    document.update(changes)
    return json.dumps(document).encode()


triangle = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}

with test.check("hostile scenes are failed jobs with a reason, in bounded time"):
    nan = struct.pack("<9f", 0, 0, 0, float("nan"), 0, 0, 0, 1, 0)
    huge = struct.pack("<9f", 0, 0, 0, float("inf"), 0, 0, 0, 1, 0)
    for name, document, data in (
            ("cycle", gltf(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}]), triangle),
            ("count", gltf(accessors=[dict(accessor, count=10 ** 9)]), triangle),
            ("nan", gltf(), nan), ("infinite", gltf(), huge),
            ("climb", gltf(buffers=[{"uri": "../../jobs.db", "byteLength": 36}]), triangle)):
        status = client.finished_job(client.submit({"a.gltf": document, "a.bin": data}, "a.gltf",
                                                   WHO["ann"], resolution=64).job, WHO["ann"])
        assert status.state == B.JOB_FAILED and status.failure == B.FAILURE_REJECTED, (name, status)
        assert len(status.cause) > 10 and test.folder not in status.cause, (name, status.cause)
    assert leftovers() == [], leftovers()

with test.check("a setting that the bake refuses is a failed job that says so"):
    status = client.finished_job(client.submit({"a.glb": scene}, "a.glb", WHO["ann"],
                                               resolution=1000).job, WHO["ann"])
    assert status.failure == B.FAILURE_REJECTED and "--resolution: '1000'" in status.cause, status


def submit_held(**settings):
    """A job that goes on until it is ended, or until a retry without HOLD; returns it and its
    workers."""
    open(HOLD, "w", encoding="ascii").close()
    job = client.submit({"a.glb": scene}, "a.glb", WHO["ann"], **settings).job
    return job, ut.wait_until(lambda: workers(daemon), 20, "the bake runs")


with test.check("a cancelled bake ends with all its processes"):
    job, _ = submit_held(resolution=4096)
    status = client.cancel_job(B.CancelRequest(job=job), metadata=WHO["ann"])
    assert status.state == B.JOB_FAILED and status.failure == B.FAILURE_CANCELLED
    ut.wait_until(lambda: not workers(daemon) and not leftovers(), 10, "nothing is left")

with test.check("a worker that is killed is tried again, and the asset is published once"):
    job, pids = submit_held(resolution=1024)
    os.remove(HOLD)
    os.kill(pids[0], signal.SIGKILL)
    status = client.finished_job(job, WHO["ann"])
    assert status.state == B.JOB_DONE and status.epoch == 2, status
    assert daemon.metric("umbrage_job_failures_total") >= 1

with test.check("a program that cannot be started is an internal failure with its exit code"):
    os.makedirs(test.path("bin"))
    with open(os.open(test.path("bin", "bake"), os.O_WRONLY | os.O_CREAT, 0o755), "w") as file:
        file.write("#!/nowhere/at/all\n")
    other = test.daemon("--jobs", test.path("jobs2"), "--bake-program", test.path("bin", "bake"),
                        "--token-file", TOKENS, store=test.path("store2"))
    broken = test.client(other.grpc_tcp)
    status = broken.finished_job(broken.submit({"a.glb": scene}, "a.glb", WHO["ann"]).job, WHO["ann"])
    assert status.failure == B.FAILURE_INTERNAL and status.cause == "the bake ended with 127", status
    broken.close()
    other.stop()

with test.check("a daemon that is killed loses nothing, and leaves no process and no temporary"):
    job, _ = submit_held(resolution=2048)
    client.close()
    daemon.kill()
    os.remove(HOLD)
    ut.wait_until(lambda: not workers(daemon), 10, "its workers ended with it")
    open(os.path.join(ASSETS, ".tmp." + 64 * "a" + ".umb.1.1.1"), "w", encoding="ascii").close()
    os.mkdir(os.path.join(JOBS, "incoming", "half"))
    daemon, client = start("--bake-workers", 2)
    status = client.finished_job(job, WHO["ann"])
    assert status.state == B.JOB_DONE and status.epoch == 2, status
    assert leftovers() == [], leftovers()

with test.check("a clean restart goes on with a job and counts no failure"):
    job, _ = submit_held(resolution=2048, closed="off")
    client.close()
    daemon.stop()
    assert not workers(daemon)
    os.remove(HOLD)
    daemon, client = start("--bake-workers", 2)
    status = client.finished_job(job, WHO["ann"])
    assert status.state == B.JOB_DONE and status.failure == B.FAILURE_NONE, status

with test.check("an asset goes when its last owner deletes it"):
    path = os.path.join(ASSETS, plain + ".umb")
    client.delete_asset(B.DeleteRequest(asset=plain), metadata=WHO["ann"])
    client.refused(lambda: client.delete_asset(B.DeleteRequest(asset=plain), metadata=WHO["ann"]),
                   Code.NOT_FOUND)
    assert os.path.exists(path)
    client.delete_asset(B.DeleteRequest(asset=plain), metadata=WHO["bob"])
    assert not os.path.exists(path)

test.finish()
