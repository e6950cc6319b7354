#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Place of the job table: not on a network file system, and used by one daemon only. A preloaded library
imitates other file systems (fstatfs of one folder). The test writes the lock files of other machines.
"""
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

if ut.is_sanitized():
    ut.skip("a preloaded library and a sanitizer do not go together")
grpc, _ = ut.need_grpc()
test = ut.Test()
B = test.messages.bakes
NFS, LUSTRE, OVERLAY = "0x6969", "0x0BD00BD0", "0x794C7630"
SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/vfs.h>
#include <unistd.h>
int fstatfs64(int fd, struct statfs64 *facts)
{
    int (*real)(int, struct statfs64 *) = (int (*)(int, struct statfs64 *))dlsym(RTLD_NEXT, "fstatfs64");
    const char *under = getenv("PRETEND_UNDER"), *type = getenv("PRETEND_TYPE");
    char link[64], path[4096];
    int code = real(fd, facts);
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (code == 0 && under != NULL && length > 0) {
        path[length] = 0;
        if (strncmp(path, under, strlen(under)) == 0)
            facts->f_type = (long)strtoul(type, NULL, 16);
    }
    return code;
}
int fstatfs(int fd, struct statfs *facts)
{
    return fstatfs64(fd, (struct statfs64 *)facts);
}
"""
with open(test.path("shim.c"), "w", encoding="ascii") as file:
    file.write(SHIM)
compiler = subprocess.run(["cc", "-shared", "-fPIC", "-o", test.path("shim.so"), test.path("shim.c"),
                           "-ldl"], capture_output=True, check=False)
if compiler.returncode != 0:
    ut.skip("no compiler for the library that pretends a file system")

TOKENS = test.path("tokens")
ANN = [("authorization", "Bearer ann-0123456789abcdef")]
with open(os.open(TOKENS, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
    file.write("ann query,submit ann-0123456789abcdef\n")
with open(test.scene("city", 2), "rb") as file:
    SCENE = {"a.glb": file.read()}
SHARED, LOCAL = os.path.realpath(test.path("shared")), test.path("local")
os.mkdir(SHARED, 0o700)
os.mkdir(LOCAL, 0o700)


class Pretending:
    """Programs started meanwhile find the shared folder on a file system of that type."""

    def __init__(self, kind):
        self.kind = kind

    def __enter__(self):
        os.environ.update(LD_PRELOAD=test.path("shim.so"), PRETEND_UNDER=SHARED,
                          PRETEND_TYPE=self.kind)

    def __exit__(self, *_):
        for name in ("LD_PRELOAD", "PRETEND_UNDER", "PRETEND_TYPE"):
            del os.environ[name]


def words(jobs, *more):
    return ["--jobs", jobs, "--token-file", TOKENS, "--bake-threads", 1, *more]


def daemon_on(jobs, *more):
    return test.daemon(*words(jobs, *more))


def refused(jobs, *more, kind=None, code=None):
    """Runs a daemon that must not start; what it says in its last line."""
    command = [ut.program("umbraged"), "--store", test.path("store"), "--listen",
               "unix:" + test.path("no.sock"), *map(str, words(jobs, *more))]
    with Pretending(kind or "0xEF53"):
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == code if code else done.returncode != 0, (done.returncode, done.stderr)
    return done.stderr.strip().splitlines()[-1]


def bakes(daemon):
    client = test.client(daemon.grpc_tcp)
    job = client.submit(SCENE, "a.glb", ANN, resolution=128, verify=0).job
    status = client.finished_job(job, ANN)
    client.close()
    assert status.state == B.JOB_DONE, status
    return status.asset.hex()


def end(daemon):
    daemon.stop()
    test.daemons.remove(daemon)


with test.check("a table on a network file system is refused with the way out"):
    os.makedirs(test.path("store"), exist_ok=True)
    for kind, name in ((NFS, "NFS"), (LUSTRE, "Lustre")):
        jobs = os.path.join(SHARED, "jobs-" + name)
        said = refused(jobs, kind=kind, code=2)
        assert f"is on {name}" in said and "--jobs-db FILE" in said, said
        said = refused(jobs, "--executor", "slurm", kind=kind, code=2)
        assert f"is on {name}" in said, said
        said = refused(jobs, "--check", kind=kind)
        assert f"is on {name}" in said, said
        assert not os.path.exists(os.path.join(jobs, "jobs.db"))
with test.check("with the table on a local disk the folder may be on a network file system"):
    jobs, table = os.path.join(SHARED, "jobs"), os.path.join(LOCAL, "jobs.db")
    with Pretending(NFS):
        daemon = daemon_on(jobs, "--jobs-db", table)
    asset = bakes(daemon)
    assert os.path.exists(table) and not os.path.exists(os.path.join(jobs, "jobs.db"))
    said = refused(jobs, "--jobs-db", os.path.join(LOCAL, "second.db"))
    assert f"pid {daemon.process.pid} on host '{os.uname().nodename}'" in said, said
    said = refused(test.path("jobs-other"), "--jobs-db", table)
    assert "--jobs-db" in said and f"pid {daemon.process.pid} on host" in said, said
    end(daemon)
with test.check("a table that would be left behind is told of, and moved by hand it goes on"):
    daemon = daemon_on(test.path("jobs-before"))
    asset = bakes(daemon)
    end(daemon)
    moved = os.path.join(LOCAL, "moved.db")
    said = refused(test.path("jobs-before"), "--jobs-db", moved, code=2)
    assert "move jobs.db" in said, said
    os.rename(test.path("jobs-before", "jobs.db"), moved)
    daemon = daemon_on(test.path("jobs-before"), "--jobs-db", moved)
    client = test.client(daemon.grpc_tcp)
    jobs_there = client.list_jobs(B.ListJobsRequest(), metadata=ANN, timeout=60).jobs
    assert [job.asset.hex() for job in jobs_there] == [asset], jobs_there
    end(daemon)
with test.check("a jobs folder that others can change is told of"):
    os.chmod(test.path("jobs-before"), 0o770)
    daemon = daemon_on(test.path("jobs-before"), "--jobs-db", moved)
    assert "event=jobs_not_private" in daemon.log() and "mode 0770" in daemon.log(), daemon.log()
    end(daemon)
    os.chmod(test.path("jobs-before"), 0o700)
    daemon = daemon_on(test.path("jobs-before"), "--jobs-db", moved)
    assert "event=jobs_not_private" not in daemon.log()
    end(daemon)
with test.check("a daemon that was killed is followed at once, whatever it left in the lock"):
    daemon = daemon_on(test.path("jobs-killed"))
    daemon.kill()
    test.daemons.remove(daemon)
    with open(test.path("jobs-killed", "lock"), encoding="ascii") as file:
        assert re.fullmatch(r"\S+ \S+ \d+ [0-9a-f]{16} \d+\n", file.read())
    daemon = daemon_on(test.path("jobs-killed"))
    end(daemon)
    assert os.path.getsize(test.path("jobs-killed", "lock")) == 0
with test.check("where locks are not enough a daemon shows that it lives, and stops when it is replaced"):
    jobs, table = os.path.join(SHARED, "jobs-beats"), os.path.join(LOCAL, "beats.db")
    with Pretending(OVERLAY):
        daemon = daemon_on(jobs, "--jobs-db", table)
    lock = os.path.join(jobs, "lock")

    def number():
        with open(lock, encoding="ascii") as file:
            return int((file.read().split() or ["0"])[-1])
    first = number()
    ut.wait_until(lambda: number() > first, 30, "the number moves")
    bakes(daemon)
    with open(lock, "w", encoding="ascii") as file:
        file.write("far-host 11111111-2222-3333-4444-555555555555 4711 0123456789abcdef 9\n")
    ut.wait_until(lambda: "event=jobs_lost" in daemon.log(), 30, "it finds out")
    assert "far-host" in daemon.log()
    client = test.client(daemon.grpc_tcp)
    client.refused(lambda: client.cancel_job(B.CancelRequest(job=client.list_jobs(
        B.ListJobsRequest(), metadata=ANN).jobs[0].job), metadata=ANN),
        grpc.StatusCode.UNAVAILABLE, "taken over")
    client.refused(lambda: client.submit({"b.glb": SCENE["a.glb"] + b"\0\0\0\0"}, "b.glb", ANN,
                                         resolution=64), grpc.StatusCode.UNAVAILABLE, "taken over")
    end(daemon)
    assert os.path.getsize(lock) > 0, "the line of the other daemon is not ours to remove"
test.finish()
