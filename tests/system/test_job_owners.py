#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Owners of jobs must not affect each other. An owner's asset must be invisible to others, also when it is
damaged. Baking a shared asset must not take it from other owners. A job for an asset that others own
must not get lost or end without a file.
"""
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
test = ut.Test()
B, S = test.messages.bakes, test.messages.shadows
STORE, JOBS, TOKENS = test.path("store"), test.path("jobs"), test.path("tokens")
ASSETS = os.path.join(JOBS, "assets")
WHO = {name: [("authorization", f"Bearer {name}-0123456789abcdef")]
       for name in ("ann", "bob", "eve")}
with open(os.open(TOKENS, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
    for name, scopes in (("ann", "query,submit"), ("bob", "query,submit"), ("eve", "query")):
        file.write(f"{name} {scopes} {name}-0123456789abcdef\n")

with open(test.scene("city", 4), "rb") as file:
    scene = {"a.glb": file.read()}
os.makedirs(STORE, exist_ok=True)
public = test.bake(test.scene("city", 4), test.path("store", "city.umb"), "--resolution", 256,
                   "--sun", "120,40", "--verify", 20000)["asset"]
daemon = test.daemon("--jobs", JOBS, "--token-file", TOKENS, "--bake-threads", 1, "--job-lease",
                     "1s")
client = test.client(daemon.grpc_tcp)


def bake(who, **settings):
    job = client.submit(scene, "a.glb", WHO[who], **{"verify": 20000, **settings}).job
    return client.finished_job(job, WHO[who])


def ask(who, asset):
    return client.describe(S.DescribeRequest(asset=asset), metadata=WHO[who], timeout=60)


with test.check("baking again what lies in the store by a name takes it from nobody"):
    status = bake("ann", resolution=256, sun="120,40", verify=20000)
    assert status.state == B.JOB_DONE and status.asset.hex() == public, status
    for asset in ("city", public):
        assert ask("eve", asset).summary.id.hex() == public
    listed = client.list(S.ListRequest(), metadata=WHO["eve"], timeout=60).assets
    assert "city" in [asset.name for asset in listed], listed

with test.check("an operator's file named by its id stays, whoever bakes and deletes that asset"):
    own = test.bake(test.scene("city", 4), test.path("own.umb"), "--resolution", 64, "--verify", 1000)["asset"]
    path = os.path.join(STORE, own + ".umb")
    os.rename(test.path("own.umb"), path)
    before = os.stat(path)
    daemon.signal(1)
    ut.wait_until(lambda: own in [item.name for item in client.list(
        S.ListRequest(), metadata=WHO["eve"], timeout=10).assets], 10, "it is served")
    assert bake("ann", resolution=64).asset.hex() == own
    assert ask("eve", own).summary.id.hex() == own
    client.delete_asset(B.DeleteRequest(asset=own), metadata=WHO["ann"])
    after = os.stat(path)
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert not os.path.exists(os.path.join(ASSETS, own + ".umb"))
    assert ask("eve", own).summary.id.hex() == own

with test.check("a damaged asset of another owner is as little there as a whole one"):
    asset = bake("ann", resolution=128, sun="120,40").asset.hex()
    with open(os.path.join(ASSETS, asset + ".umb"), "r+b") as file:
        file.truncate(os.path.getsize(file.name) // 2)
    daemon.signal(1)

    def is_damaged():
        try:
            ask("ann", asset)
        except grpc.RpcError as error:
            return error.code() == Code.DATA_LOSS
        return False

    ut.wait_until(is_damaged, 10, "its owner hears of the damage")
    client.refused(lambda: ask("eve", asset), Code.NOT_FOUND, "no asset named")

with test.check("the same scene of two owners is one asset, if it takes longer than the lease too"):
    settings = {"resolution": 1024, "sun": "120,40", "verify": 4000000}
    bakes = 1  # bob's
    while True:
        first = bake("ann", **settings)
        bakes += 1
        assert first.state == B.JOB_DONE, first
        if first.ended_ms - first.started_ms > 2000:
            break  # twice as long as the lease, or it proves nothing
        settings["verify"] += settings["verify"] // 2
    second = bake("bob", **settings)
    assert second.asset == first.asset and second.epoch == 1, second
    asset = first.asset.hex()

with test.check("what another owner has is loaded once more, as if it were the first"):
    loads = [line for line in daemon.log().splitlines()
             if "asset_loaded" in line and f"id={asset}" in line]
    assert len(loads) == bakes and all("how=proven" in line for line in loads), (bakes, loads)
    assert "cache_rebuilt" not in daemon.log()

with test.check("an asset that its other owner deletes meanwhile is there at the end"):
    client.delete_asset(B.DeleteRequest(asset=asset), metadata=WHO["bob"])
    job = client.submit(scene, "a.glb", WHO["bob"], **settings).job
    for seen in client.watch_job(B.WatchRequest(job=job), metadata=WHO["bob"], timeout=60):
        if seen.state == B.JOB_RUNNING:
            client.delete_asset(B.DeleteRequest(asset=asset), metadata=WHO["ann"])
            break
    status = client.finished_job(job, WHO["bob"])
    assert status.state == B.JOB_DONE and status.asset.hex() == asset, status
    assert os.path.exists(os.path.join(ASSETS, asset + ".umb"))
    assert ask("bob", asset).summary.id.hex() == asset

with test.check("of two submissions at once, the later leaves no bundle behind"):
    manifest = client.manifest(scene, "a.glb", resolution=64)

    def late():
        yield B.SubmitRequest(manifest=manifest)
        bake("ann", resolution=64)
        yield B.SubmitRequest(data=scene["a.glb"])

    reply = client.raw_submit(late(), timeout=60, metadata=WHO["ann"])
    assert client.finished_job(reply.job, WHO["ann"]).state == B.JOB_DONE
    assert os.listdir(os.path.join(JOBS, "bundles")) == []

with test.check("a daemon without jobs does not serve what jobs made, and one with them refuses to"):
    job_asset = bake("ann", resolution=128, sun="100,40").asset.hex()
    other = test.daemon(store=STORE)
    plain = test.client(other.grpc_tcp)
    plain.refused(lambda: plain.describe(S.DescribeRequest(asset=job_asset), timeout=10),
                  Code.NOT_FOUND, "no asset named")
    plain.close()
    other.stop()
    for folder in (JOBS, ASSETS):
        refused = ut.run("umbraged", "--store", folder, "--jobs", JOBS, code=2).stderr.decode()
        assert "--jobs" in refused and "is a --store too" in refused, refused

test.finish()
