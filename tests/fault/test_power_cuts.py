#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Power cuts below the store and the job table. A run is recorded; every state that a disk may hold
after a cut at any moment of it (power_cut.py has the model and its limits) is written to a folder
and opened again. Then:

- an output of `umbrage-bake`, `umbrage pack` and `umbrage fetch` is the old one or the new one, and
  the new one after exit code 0;
- a bake on the tiles that a cut left makes the right asset;
- a mapped file in a daemon's cache is whole or absent, and a daemon on it answers right;
- an acknowledged job exists: with its whole bundle, or finished;
- a job that was reported as done is done, and its asset is whole; no asset is incomplete under its
  name; no unfinished job is without its bundle. All this holds after a second cut, in the recovery.

FAULT=short makes fewer images of each.
"""
import hashlib
import json
import os
import subprocess

import fault_sweep as fs
import power_cut
from fault_sweep import ut

test = ut.Test(limit_s=240 if fs.SHORT else 3600)
sweep = fs.Sweep(test)
SEED = int(os.environ.get("UMBRAGE_SEED", "18"))
EXACT, SAMPLE = (32, 6) if fs.SHORT else (1024, 64)
DAEMONS = 2 if fs.SHORT else 24  # images that a whole daemon is started on
CROWD = 12                       # assets of a store; a cache syncs the first 8 one by one
AGAIN = 4 if fs.SHORT else 12    # images whose recovery is cut, too
BAKES = 8 if fs.SHORT else 200   # images of tiles that are baked on
print(f"seed {SEED}, all subsets up to {EXACT}, samples of {SAMPLE}")
IMAGE = power_cut.folder_for_images(test)
OPTIONS = ("--resolution", 256, "--verify", 0)
old_scene, new_scene = test.scene("city", 1, form="ply"), test.scene("city", 2, form="ply")


def read(*names):
    with open(os.path.join(*names), "rb") as file:
        return file.read()


def tell(run, images):
    print(f"    {len(run.cuts)} cuts, {images} images")
    assert images > len(run.cuts) // 2, "hardly an image"


# ---- outputs of programs ----

def check_output(name, what, root, make, allowed_old):
    """make() writes root/name, which must be old or new after any cut, and new once it ended."""
    before = power_cut.snapshot(root)
    with power_cut.recorded(test, root) as recording:
        make()
        recording.mark("ended")
    new = read(root, name)
    run = power_cut.Run(recording, root, before)
    ended = run.marked("ended")
    count, half = 0, fs.Failures()
    for index, image in run.images(EXACT, SAMPLE, SEED):
        count += 1
        with half.point(what, image.what):
            found = image.files.get(name)
            assert found == new or found == allowed_old, "neither the old output nor the new one"
            assert found == new or index <= ended, "it ended with 0 and the old output is there"
    tell(run, count)
    half.end()


bakes = test.path("bakes")
os.mkdir(bakes)
test.bake(old_scene, os.path.join(bakes, "a.umb"), *OPTIONS)
old = read(bakes, "a.umb")

with test.check("an output of umbrage-bake is the old one or the new one"):
    check_output("a.umb", "umbrage-bake", bakes,
                 lambda: test.bake(new_scene, os.path.join(bakes, "a.umb"), *OPTIONS), old)
    assert read(bakes, "a.umb") != old

with test.check("a first output of umbrage-bake is whole or absent"):
    check_output("b.umb", "umbrage-bake", bakes,
                 lambda: test.bake(new_scene, os.path.join(bakes, "b.umb"), *OPTIONS), None)

with test.check("an output of umbrage pack is the old one or the new one"):
    packs = test.path("packs")
    os.mkdir(packs)
    ut.run("umbrage", "unpack", os.path.join(bakes, "a.umb"), "-o", test.path("a.umbm"))
    with open(os.path.join(packs, "p.umb"), "wb") as file:
        file.write(old)
    check_output("p.umb", "umbrage pack", packs,
                 lambda: ut.run("umbrage", "pack", test.path("a.umbm"), "-o",
                                os.path.join(packs, "p.umb")), old)
    assert read(packs, "p.umb") != old

# ---- the tiles of a bake ----

with test.check("a bake on any tiles that a cut left makes the right asset"):
    tiles, made = test.path("tiles"), test.path("tiled.umb")
    os.makedirs(tiles)
    TILED = ("--resolution", 256, "--tile", 64, "--verify", 0, "--cache")
    with power_cut.recorded(test, tiles) as recording:
        wanted = test.bake(new_scene, made, *TILED, tiles)["asset"]
    run = power_cut.Run(recording, tiles)
    found = {image.digest: image for _, image in run.images(EXACT, SAMPLE, SEED)}
    failures, filled = fs.Failures(), 0
    for image in list(found.values())[::max(1, len(found) // BAKES)][:BAKES]:
        with failures.point("tiles", image.what):
            image.write(os.path.join(IMAGE, "tiles"))
            filled += len(image.files) > 0
            again = test.bake(new_scene, made, *TILED, os.path.join(IMAGE, "tiles"))["asset"]
            assert again == wanted, "another asset"
    tell(run, len(found))
    failures.end()
    assert filled > failures.done // 2, "hardly an image has tiles"

# ---- the cache of a daemon ----

points = ut.floats(ut.random_points((-100, -100, -10), (100, 100, 80), 500, SEED))


def stop(daemon):
    daemon.stop()
    test.daemons.remove(daemon)


def answers_right(store, answers):
    daemon = test.daemon("--workers", 1, store=store)
    got = test.query_file("city", points, "--address", "unix:" + daemon.socket_path)
    assert got == answers, "other answers than the file's"
    stop(daemon)


with test.check("a mapped file in a daemon's cache is whole or absent"):
    store = test.path("cached")
    os.mkdir(store)
    with open(os.path.join(store, "city.umb"), "wb") as file:
        file.write(read(bakes, "a.umb"))
    answers = test.query_file(os.path.join(store, "city.umb"), points)
    before = power_cut.snapshot(store)
    with power_cut.recorded(test, store) as recording:
        daemon = test.daemon("--workers", 1, store=store)
        assert test.query_file("city", points, "--address", "unix:" + daemon.socket_path) == answers
        stop(daemon)
    run = power_cut.Run(recording, store, before)
    whole = {path: data for path, _, data in power_cut.snapshot(store) if path.endswith(".umbm")}
    assert len(whole) == 1, f"mapped files: {list(whole)}"
    count, failures, odd = 0, fs.Failures(), {}
    for index, image in run.images(EXACT, SAMPLE, SEED):
        count += 1
        with failures.point("the cache", image.what):
            for path, data in image.files.items():
                assert not path.endswith(".umbm") or whole.get(path) == data, f"{path} is not whole"
        odd[image.digest] = image
    tell(run, count)
    failures.end()
    for image in list(odd.values())[::max(1, len(odd) // DAEMONS)][:DAEMONS]:
        image.write(os.path.join(IMAGE, "store"))
        answers_right(os.path.join(IMAGE, "store"), answers)

with test.check("of many mapped files a list names only those that are whole"):
    store = test.path("crowd")
    os.mkdir(store)
    small = test.scene("box", 2)
    for turn in range(CROWD):
        test.bake(small, os.path.join(store, f"a{turn}.umb"), "--resolution", 64, "--verify", 0, "--sun",
                  f"{20 * turn},40")
    names = [f"a{turn}" for turn in range(CROWD)]
    answers = [test.query_file(os.path.join(store, name + ".umb"), points) for name in names]
    before = power_cut.snapshot(store)
    with power_cut.recorded(test, store) as recording:
        daemon = test.daemon("--workers", 1, store=store)
        stop(daemon)
    run = power_cut.Run(recording, store, before)
    whole = {path: data for path, _, data in power_cut.snapshot(store) if path.endswith(".umbm")}
    assert len(whole) == CROWD, f"mapped files: {list(whole)}"
    count, torn, named, failures, odd = 0, 0, 0, fs.Failures(), {}
    for index, image in run.images(EXACT, SAMPLE, SEED):
        count += 1
        lists = [data for path, data in image.files.items() if os.path.basename(path) == "proven"]
        with failures.point("the crowd", image.what):
            for path, data in whole.items():
                known = any(os.path.basename(path)[:64].encode() in text for text in lists)
                named += known
                torn += path in image.files and image.files[path] != data
                assert not known or image.files.get(path) == data, f"{path} is named and not whole"
        odd[image.digest] = image
    tell(run, count)
    print(f"    {torn} torn files, {named} in a list")
    failures.end()
    assert torn > 0 and named > 0, "nothing was put to the test"
    for image in list(odd.values())[::max(1, len(odd) // DAEMONS)][:DAEMONS]:
        image.write(os.path.join(IMAGE, "store"))
        daemon = test.daemon("--workers", 1, store=os.path.join(IMAGE, "store"))
        for name, right in zip(names, answers):
            assert test.query_file(name, points, "--address", "unix:" + daemon.socket_path) == right
        stop(daemon)

# ---- the bake service ----

root = test.path("root")
STORE, JOBS, SOCKET = os.path.join(root, "store"), os.path.join(root, "jobs"), test.path("s")


def service(folder=root, *more):
    """A daemon with jobs below a folder; every start is the same."""
    return subprocess.Popen(
        [ut.program("umbraged"), "--store", os.path.join(folder, "store"), "--jobs",
         os.path.join(folder, "jobs"), "--listen", "unix:" + SOCKET, "--bake-threads", "1",
         "--tile-cache", "0", "--drain-delay", "0", "--log-level", "warn", *more],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def cli(*words, code=0):
    done = ut.run("umbrage", *words, "--address", "unix:" + SOCKET, code=code, timeout=60)
    return json.loads(done.stdout) if "--json" in words else None


def up(process):
    def listens():
        assert process.poll() is None, "the daemon ended"
        return os.path.exists(SOCKET) and ut.run(
            "umbrage", "list", "--quiet", "--address", "unix:" + SOCKET, code=None).returncode == 0
    ut.wait_until(listens, fs.HANG_S, "the daemon serves")


def ended(process):
    process.terminate()
    assert process.wait(60) == 0


class Job:
    """A job of the recorded run and what was said about it."""

    def __init__(self, files, scene, state):
        """files: {path in the bundle: bytes}; state: how it ended."""
        self.bundle = {path: hashlib.sha256(data).digest() for path, data in files.items()}
        self.scene, self.state = scene, state
        self.id = self.asset = None
        self.accepted = self.done = self.dropped = power_cut.NEVER


def many_files():
    """A scene of a dozen files in folders: OBJ, its materials, what they name."""
    folder = test.path("many")
    os.makedirs(os.path.join(folder, "parts/wood"))
    files = {"scene.obj": b"mtllib parts/m.mtl\nv 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 3\nusemtl a\n"
                          b"f 1 2 3\nf 1 3 4\n",
             "parts/m.mtl": b"newmtl a\nKd 1 1 1\n" + b"# filler\n" * 200}
    for i in range(10):
        files[f"parts/wood/{i}.png"] = b"not read: shadows have no bumps" + bytes([i])
        files["parts/m.mtl"] += f"bump parts/wood/{i}.png\n".encode()
    for name, data in files.items():
        with open(os.path.join(folder, name), "wb") as file:
            file.write(data)
    return os.path.join(folder, "scene.obj"), files


def run_service(recording):
    """Submits, bakes, cancels, deletes; the jobs."""
    process = service()
    jobs = []
    try:
        up(process)
        path, files = many_files()
        for words, job in (
                ((path, *OPTIONS, "--wait"), Job(files, "scene.obj", "done")),
                ((new_scene, *OPTIONS, "--wait"),
                 Job({os.path.basename(new_scene): read(new_scene)}, "", "done")),
                ((new_scene, "--resolution", 16384, "--verify", 1000000),
                 Job({os.path.basename(new_scene): read(new_scene)}, "", "failed"))):
            status = cli("submit", *words, "--json")
            job.id, job.asset = status["job"], status.get("asset") or None
            jobs.append(job)
        kept = {job.asset + ".umb": read(JOBS, "assets", job.asset + ".umb")
                for job in jobs if job.asset}
        cli("cancel", jobs[-1].id)
        recording.mark("cancelled")
        ut.wait_until(lambda: not os.listdir(os.path.join(JOBS, "work")), 20, "no work is left")
        recording.mark("delete")
        cli("rm", jobs[0].asset)
        ended(process)
    finally:
        process.kill()
        process.wait()
    for name, data in kept.items():  # what later images are held against
        with open(test.path(name), "wb") as file:
            file.write(data)
        ut.run("umbrage", "verify", test.path(name))
    return jobs, {name: hashlib.sha256(data).digest() for name, data in kept.items()}


class Outcome:
    """What the service makes of an image of the disk."""

    def __init__(self, folder, opener):
        opener.stdin.write(folder + "/jobs\n")
        opener.stdin.flush()
        self.jobs, self.end = {}, None
        while self.end is None:
            words = opener.stdout.readline().split(None, 1)
            assert words, "open_jobs died"
            if words[0] == "end":
                self.end = words[1].strip()
            else:
                job, state, asset = words[1].split()
                self.jobs[job] = (state, asset)
        self.bundles = [self.tree(os.path.join(folder, "jobs/bundles", name))
                        for name in self.list(folder, "bundles")]
        self.assets = {name: hashlib.sha256(read(folder, "jobs/assets", name)).digest()
                       for name in self.list(folder, "assets") if name.endswith(".umb")}
        # What was moved aside to be removed may outlive a service that ends at once.
        self.left = [name for name in self.list(folder, "incoming") + self.list(folder, "work")
                     if not name.startswith("gone.")]

    @staticmethod
    def list(folder, name):
        path = os.path.join(folder, "jobs", name)
        return os.listdir(path) if os.path.isdir(path) else []

    @staticmethod
    def tree(folder):
        return {path: hashlib.sha256(data).digest()
                for path, _, data in power_cut.snapshot(folder) if data is not None}


def check_outcome(outcome, index, jobs, assets):
    assert outcome.end == "ok", f"the table does not open: {outcome.end}"
    assert not outcome.left, f"left behind: {outcome.left}"
    for name, digest in outcome.assets.items():
        assert assets.get(name) == digest, f"{name} is not whole"
    for job in jobs:
        state, asset = outcome.jobs.get(job.id, (None, None))
        assert state is not None or index <= job.accepted, f"job {job.scene} was lost"
        if state == "done":
            assert asset == job.asset, "another asset than it made"
            assert asset + ".umb" in outcome.assets or index > job.dropped, "done without its asset"
        if state in ("queued", "running"):
            assert job.bundle in outcome.bundles, f"a job that is {state} has no whole bundle"
        assert index <= job.done or state == job.state, f"it was told as {job.state}, it is {state}"
        assert state in (None, "queued", "running", job.state), f"it is {state}"


def start_opener():
    return subprocess.Popen([ut.program("open_jobs"), ut.program("umbrage-bake")],
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def cut_again(image, index, failures):
    """Makes power cuts during the recovery from an image; returns the number of images."""
    again = test.path("again")
    image.write(again)
    before = power_cut.snapshot(again)
    with power_cut.recorded(test, again) as recording:
        first = start_opener()
        Outcome(again, first)
        first.stdin.close()
        assert first.wait() == 0
    run, seen = power_cut.Run(recording, again, before), set()
    for _, second in run.images(EXACT, SAMPLE, SEED):
        if second.digest not in seen:
            seen.add(second.digest)
            with failures.point(image.what + ", then " + second.what):
                second.write(os.path.join(IMAGE, "jobs"))
                check_outcome(Outcome(os.path.join(IMAGE, "jobs"), opener), index, jobs, assets)
    return len(seen)


def bake_all(folder, outcome, jobs):
    """Starts a whole daemon on an image; it must bring all unfinished jobs to an end."""
    process = service(folder)
    try:
        up(process)
        for job in jobs:
            if outcome.jobs.get(job.id, ("", ""))[0] == "queued" and job.state == "done":
                status = cli("watch", job.id, "--json")
                assert status["state"] == "done" and status["asset"] == job.asset, status
        ended(process)
    finally:
        process.kill()
        process.wait()


with test.check("no power cut loses an accepted job, a bundle or an asset"):
    os.makedirs(STORE)
    before = power_cut.snapshot(root)
    with power_cut.recorded(test, root) as recording:
        jobs, assets = run_service(recording)
    run = power_cut.Run(recording, root, before)
    assert len(assets) == 2, assets
    for job in jobs:
        job.accepted = run.first_sent(job.id.encode())
        assert job.accepted < power_cut.NEVER, "the reply to Submit was not seen"
        if job.asset:
            job.done = run.first_sent(bytes.fromhex(job.asset))
            job.done = min(job.done, run.first_sent(job.asset.encode()))
            assert job.accepted < job.done < power_cut.NEVER, "the end of the job was not seen"
    jobs[0].dropped = run.marked("delete")
    jobs[-1].done = run.marked("cancelled")
    opener = start_opener()
    outcomes, count, failures, chosen = {}, 0, fs.Failures(), []
    for index, image in run.images(EXACT, SAMPLE, SEED):
        count += 1
        with failures.point(image.what):
            if image.digest not in outcomes:
                image.write(os.path.join(IMAGE, "jobs"))
                outcomes[image.digest] = Outcome(os.path.join(IMAGE, "jobs"), opener)
                chosen.append((image, index))
            check_outcome(outcomes[image.digest], index, jobs, assets)
    tell(run, count)
    states = [state for outcome in outcomes.values() for state, _ in outcome.jobs.values()]
    print(f"    {len(outcomes)} different ones; jobs in them: " + ", ".join(
        f"{states.count(name)} {name}" for name in sorted(set(states))))
    failures.end()
    for wanted in ("queued", "done", "failed"):
        assert wanted in states, f"no image has a job that is {wanted}"

with test.check("nor does a second one, while a daemon recovers from the first"):
    failures, count = fs.Failures(), 0
    some = [pair for pair in chosen if outcomes[pair[0].digest].jobs]
    for image, index in some[::max(1, len(some) // AGAIN)][:AGAIN]:
        count += cut_again(image, index, failures)
    print(f"    {AGAIN} recoveries, {count} images")
    failures.end()
    assert count > AGAIN, "hardly an image"
opener.stdin.close()
opener.wait()

with test.check("an output of umbrage fetch is the old one or the new one"):
    fetched = test.path("fetched")
    os.mkdir(fetched)
    with open(os.path.join(fetched, "f.umb"), "wb") as file:
        file.write(old)
    process = service()  # not recorded: what it keeps is the checks' above
    try:
        up(process)
        check_output("f.umb", "umbrage fetch", fetched,
                     lambda: cli("fetch", jobs[1].asset, "-o", os.path.join(fetched, "f.umb")), old)
        assert read(fetched, "f.umb") != old
        ended(process)
    finally:
        process.kill()
        process.wait()

with test.check("a daemon on what a cut left bakes what it owes"):
    daemons = 0
    for image, index in chosen:
        outcome = outcomes[image.digest]
        owes = [job for job in jobs if outcome.jobs.get(job.id, ("",))[0] == "queued"]
        if owes and owes[-1].state == "done" and daemons < DAEMONS:
            daemons += 1
            image.write(os.path.join(IMAGE, "jobs"))
            os.makedirs(os.path.join(IMAGE, "jobs", "store"), exist_ok=True)
            bake_all(os.path.join(IMAGE, "jobs"), outcome, jobs)
    print(f"    {daemons} daemons")
    assert daemons > 0, "no image owes a bake"

test.finish()
