#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Files that only the daemon may write. The test acts as real users: members of a store's group,
members of a socket's group, and other users. Needs root, to act as them.
"""
import os
import shutil
import socket
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

if os.geteuid() != 0:
    ut.skip("needs root, to act as other users")
grpc, _ = ut.need_grpc()
test = ut.Test()
MEMBER, STRANGER, GROUP = 41234, 41235, 41236
SEED = 7
print(f"seed {SEED}")

os.chmod(test.folder, 0o755)
for name, size, seed in (("city", 3, 1), ("other", 4, 3)):
    test.bake(test.scene("city", size, seed), test.path(name + ".umb"), "--resolution", 512,
              "--depth", "raster", "--verify", 0)
points = ut.floats(ut.random_points((-60, -10, -60), (60, 60, 60), 5000, SEED))
answers = {name: test.query_file(test.path(name + ".umb"), points, "--taps", 3, encoding="u8")
           for name in ("city", "other")}
assert answers["city"] != answers["other"], "the assets must differ to tell them apart"
ut.run("umbrage", "unpack", test.path("other.umb"), "-o", test.path("other.umbm"))


def as_user(uid, gid, act):
    """Runs act() in a child process of that user; its exit code (0, or the errno of an OSError)."""
    child = os.fork()
    if child == 0:
        code = 0
        try:
            os.setgroups([])
            os.setgid(gid)
            os.setuid(uid)
            act()
        except OSError as error:
            code = error.errno or 255
        os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def store_of(name, mode):
    store = test.path(name)
    os.mkdir(store)
    shutil.copyfile(test.path("city.umb"), os.path.join(store, "city.umb"))
    os.chown(store, 0, GROUP)
    os.chmod(store, mode)
    return store


def daemon_on(store, *words):
    daemon = ut.Daemon(test.folder, store, *words)
    test.daemons.append(daemon)
    return daemon


def answers_right(daemon):
    client = test.client(daemon.grpc_tcp)
    assert client.ask("city", points, taps=3).visibility == answers["city"], "another asset's answers"
    client.close()


def refuses(*words):
    """Runs a daemon that must not start; what it says."""
    done = subprocess.run([ut.program("umbraged"), "--listen", "unix:" + test.path("no.sock"), *words],
                          capture_output=True, text=True, timeout=120)
    assert done.returncode != 0, "it served"
    return done.stderr


def connect(path):
    with socket.socket(socket.AF_UNIX) as end:
        end.connect(path)


with test.check("a member of the store's group cannot lay another asset under an id"):
    store = store_of("group-store", 0o2775)
    cache = os.path.join(store, ".umbrage-cache")
    first = daemon_on(store)
    answers_right(first)
    assert "event=cache_refused" in first.log() and "other users can change" in first.log()
    assert not os.path.exists(cache), "left where others may write"
    first.stop()

    def forge():
        os.mkdir(cache)
        shutil.copyfile(test.path("other.umbm"), os.path.join(cache, "other.umbm"))
        with open(os.path.join(cache, "key"), "wb") as file:
            file.write(bytes(32))
        os.chmod(os.path.join(cache, "key"), 0o600)
    assert as_user(MEMBER, GROUP, forge) == 0
    second = daemon_on(store)
    answers_right(second)
    assert "event=cache_refused" in second.log()
    second.stop()
with test.check("a cache of the daemon's own is beyond the reach of others, and known the next time"):
    cache = test.path("own-cache")
    for how in ("proven", "known"):
        daemon = daemon_on(store, "--cache", cache)
        answers_right(daemon)
        assert f"how={how}" in daemon.log(), daemon.log()
        daemon.stop()
    for uid, gid in ((MEMBER, GROUP), (STRANGER, STRANGER)):
        assert as_user(uid, gid, lambda: os.listdir(cache)) != 0
        assert as_user(uid, gid, lambda: os.rename(cache, cache + ".x")) != 0
        assert as_user(uid, gid, lambda: open(os.path.join(cache, "key"), "rb").close()) != 0
with test.check("a cache that a member could change or swap is refused by name"):
    bad = test.path("bad")
    os.mkdir(bad)
    os.chown(bad, 0, GROUP)
    os.chmod(bad, 0o775)
    os.mkdir(os.path.join(bad, "cache"), 0o700)
    said = refuses("--store", store, "--cache", os.path.join(bad, "cache"))
    assert "--cache" in said and "mode 0775" in said, said
    os.mkdir(test.path("theirs"), 0o700)
    os.chown(test.path("theirs"), MEMBER, GROUP)
    said = refuses("--store", store, "--cache", test.path("theirs"))
    assert f"uid {MEMBER}" in said, said
    said = refuses("--store", store, "--cache", test.path("theirs"), "--check")
    assert f"uid {MEMBER}" in said, said
with test.check("CACHE_DIRECTORY of systemd is the cache if no option names one"):
    os.environ["CACHE_DIRECTORY"] = test.path("systemd-cache") + ":/nowhere"
    os.mkdir(test.path("systemd-cache"), 0o700)
    try:
        daemon = daemon_on(store)
    finally:
        del os.environ["CACHE_DIRECTORY"]
    answers_right(daemon)
    daemon.stop()
    assert any(name.endswith(".umbm") for name in os.listdir(test.path("systemd-cache")))
with test.check("a second daemon on a cache reads it, names the first, and writes nothing"):
    first = daemon_on(store, "--cache", cache)
    second = daemon_on(store, "--cache", cache)
    answers_right(second)
    assert "event=cache_shared" in second.log(), second.log()
    assert f"pid {first.process.pid} on host" in second.log(), second.log()
    assert "how=known" in second.log()
    first.kill()
    second.stop()
    third = daemon_on(store, "--cache", cache)
    assert "event=cache_shared" not in third.log()
    third.stop()
with test.check("a Unix socket is its group's, whatever the umask"):
    for mask, words, member, stranger in ((0o027, (), True, False),
                                          (0o077, (), True, False),
                                          (0o000, (), True, False),
                                          (0o000, ("--socket-mode", "0600"), False, False),
                                          (0o077, ("--socket-mode", "0666"), True, True)):
        folder = test.path("run")
        os.mkdir(folder)
        os.chown(folder, 0, GROUP)
        os.chmod(folder, 0o2755)
        path = os.path.join(folder, "umbraged.sock")
        before = os.umask(mask)
        try:
            daemon = ut.Daemon(test.folder, test.path("city-store-" + oct(mask)), "--listen",
                               "unix:" + path, *words)
        finally:
            os.umask(before)
        test.daemons.append(daemon)
        mode = os.stat(path).st_mode & 0o7777
        assert mode == int(words[1] if words else "0660", 8), oct(mode)
        assert (as_user(MEMBER, GROUP, lambda: connect(path)) == 0) == member, (mask, words)
        assert (as_user(STRANGER, STRANGER, lambda: connect(path)) == 0) == stranger, (mask, words)
        daemon.stop()
        assert not os.path.exists(path)
        os.rmdir(folder)
    for bad in ("0060", "888", "01666", "", "rw"):
        said = refuses("--store", store, "--socket-mode", bad)
        assert "--socket-mode" in said, said
test.finish()
