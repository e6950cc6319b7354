#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The reach of a submitter's bytes: a scene buffer must be refused under every name, no process may
read the bytes outside a sandbox, and a bake that an attacker controls may open only its own files.
"""
import ctypes.util
import errno
import json
import os
import re
import shutil
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
if ut.is_sanitized():
    ut.skip("sanitizer builds are exempt from the sandbox")
B = test.messages.bakes
JOBS, TOKENS, FILES = test.path("jobs"), test.path("tokens"), test.path("other")
HEAD = 16  # of a scene buffer's file: magic, checksum
WHO = {name: [("authorization", f"Bearer {name}-0123456789abcdef")] for name in ("ann", "bob")}
with open(os.open(TOKENS, os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as file:
    for name in WHO:
        file.write(f"{name} query,submit {name}-0123456789abcdef\n")
ENDINGS = (".glb", ".gltf", ".obj", ".ply", ".stl")


def start(*options):
    daemon = test.daemon("--jobs", JOBS, "--token-file", TOKENS, "--bake-threads", 1, *options)
    return daemon, test.client(daemon.grpc_tcp)


def read(path):
    with open(path, "rb") as file:
        return file.read()


def leftovers():
    return [f"{folder}/{name}" for folder in ("incoming", "bundles", "work")
            for name in os.listdir(os.path.join(JOBS, folder))]


def checksum(data):
    library = ctypes.CDLL(ctypes.util.find_library("xxhash"))
    library.XXH3_64bits.restype = ctypes.c_uint64
    return library.XXH3_64bits(data, ctypes.c_size_t(len(data)))


def with_checksum(data):
    return b"UMBSCF1\n" + struct.pack("<Q", checksum(data)) + data


scene_path = test.scene("city", 2)
scene = read(scene_path)
ut.run("umbrage-bake", "import", scene_path, "-o", test.path("once"), "--quiet")
whole = read(test.path("once"))
wild = bytearray(whole[HEAD:])
for at in range(200, len(wild) - 8, 40):  # behind the head, whose counts stay right
    struct.pack_into("<d", wild, at, (1e300, -1e15, 4.9e-324, float("nan"))[at // 40 % 4])
BUFFERS = {"whole": whole, "truncated": whole[:len(whole) // 2], "head only": whole[:8],
           "wild numbers, right checksum": with_checksum(bytes(wild))}
assert with_checksum(whole[HEAD:]) == whole, "the checksum of this test is another one"
daemon, client = start()

with test.check("a scene buffer is refused under every name, at once, and leaves nothing"):
    for what, data in BUFFERS.items():
        for ending in ENDINGS:
            begin = time.monotonic()
            client.refused(lambda: client.submit({"evil" + ending: data}, "evil" + ending,
                                                 WHO["ann"]),
                           Code.INVALID_ARGUMENT, "files[0]", "UMBSCF1")
            client.refused(lambda: client.submit({"a.obj": b"v 0 0 0\n", "b" + ending: data},
                                                 "a.obj", WHO["ann"]),
                           Code.INVALID_ARGUMENT, "files[1]", "UMBSCF1")
            assert time.monotonic() - begin < 20, (what, ending)
    ut.wait_until(lambda: leftovers() == [], 20, "nothing is left of refused bundles")

with test.check("nor does umbrage-bake take one without the word: the importer refuses it"):
    for what, data in BUFFERS.items():
        for ending in ENDINGS:
            path = test.path("evil" + ending)
            with open(path, "wb") as file:
                file.write(data)
            done = subprocess.run([ut.program("umbrage-bake"), path, "--plan", "--sandbox",
                                   "required"], capture_output=True, timeout=60, check=False)
            assert done.returncode == 65 and b"UMBSCF1" in done.stderr, (what, ending, done)

with test.check("with the word, wild numbers are refused or baked in bounded time, never a crash"):
    path = test.path("wild")
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(BUFFERS["wild numbers, right checksum"])
    done = subprocess.run([ut.program("umbrage-bake"), "--scene-buffer", path, "-o",
                           test.path("wild.umb"), "--resolution", "64"], capture_output=True,
                          timeout=60, check=False)
    assert done.returncode in (0, 65), done

with test.check("the doctor proves both sandboxes, with the service's own files"):
    held = client.submit({"b.glb": scene}, "b.glb", WHO["bob"], resolution=256, verify=1000)
    assert client.finished_job(held.job, WHO["bob"]).state == B.JOB_DONE
    asset = os.path.join(JOBS, "assets", os.listdir(os.path.join(JOBS, "assets"))[0])
    secret = [TOKENS, os.path.join(JOBS, "jobs.db"), asset]
    words = [word for path in secret for word in ("--forbid", path)]
    told = json.loads(ut.run("umbrage-bake", "doctor", "--json", *words).stdout)
    assert told["allowed"] == 0 and told["bake_sandbox"] == "full", told
    assert list(told["forbidden"].values()) == ["refused"] * 3, told["forbidden"]
    assert set(told["needs"].values()) == {"works"} and len(told["needs"]) >= 4, told["needs"]
    for table in ("acts", "bake_acts", "bake_calls", "landlock_acts", "bake_landlock_acts"):
        assert told[table] and set(told[table].values()) <= {"refused", "killed"}, told[table]
    done = subprocess.run([ut.program("umbrage-bake"), "doctor", "--quiet", "--forbid",
                           test.path("missing")], check=False, capture_output=True)
    assert done.returncode == 1 and not done.stdout, done  # no proof of a file that is not there


def intrusion(sandbox):
    """What a bake of the owner ann, controlled by an attacker, gets at files of others: {path:
    (read, write)}."""
    global daemon, client
    daemon.stop()
    program = test.path("taken-over")
    tiles = os.path.join(JOBS, "tiles")
    others = [os.path.join(where, name) for where, _, names in os.walk(tiles) for name in names]
    assert others, "bob's tiles are not there"
    secret = [TOKENS, os.path.join(JOBS, "jobs.db"), os.path.join(JOBS, "assets"), asset, others[0],
              "/etc/passwd", JOBS]
    with open(os.open(program, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o755), "w",
              encoding="ascii") as file:
        file.write(f"#!/bin/sh\nINTRUDER_FILES='{':'.join(secret)}' LD_PRELOAD='"
                   f"{ut.program('intruder.so')}' exec '{ut.program('umbrage-bake')}' \"$@\"\n")
    daemon, client = start("--bake-program", program, "--job-sandbox", sandbox)
    job = client.submit({"a.glb": scene}, "a.glb", WHO["ann"], resolution=256, verify=1000,
                        sun="90,40" if sandbox == "off" else "91,40").job
    status = client.finished_job(job, WHO["ann"])
    assert status.state == B.JOB_DONE, status
    found = re.findall(r"intruder: (\S+) read=(\d+) write=(\d+)", status.notices)
    assert [path for path, _, _ in found] == secret, status.notices
    return {path: (int(read), int(write)) for path, read, write in found}


with test.check("a bake that was taken over opens nothing that is not its own"):
    for path, codes in intrusion("required").items():
        folder = os.path.isdir(path)  # which no one opens to write
        assert codes == (errno.EACCES, errno.EISDIR if folder else errno.EACCES), (path, codes)

with test.check("it can fail: without the sandbox the same bake opens them"):
    for path, codes in intrusion("off").items():
        assert codes[0] == 0, (path, codes)

CALL = re.compile(r"^(\d+) +(\w+)\((.*)$")


def unsandboxed_readers(trace, watched):
    """Reads of watched files by processes without a filter, and how many were by one with it."""
    filtered, waiting, outside, inside = set(), {}, [], 0
    for line in trace.splitlines():
        resumed = re.match(r"^(\d+) +<\.\.\. (\w+) resumed>", line)
        match = CALL.match(line)
        if resumed:
            pid, call, rest = resumed.group(1), resumed.group(2), waiting.pop(resumed.group(1), "")
        elif match:
            pid, call, rest = match.groups()
        else:
            continue
        if line.endswith("<unfinished ...>"):
            waiting[pid] = rest
        ended = re.search(r"= (\d+)$", line)
        if call == "seccomp" and "SET_MODE_FILTER" in rest and ended and ended.group(1) == "0":
            filtered.add(pid)
        elif call in ("clone", "clone3") and ended and pid in filtered:
            filtered.add(ended.group(1))
        elif not resumed and any(watched(path) for path in re.findall(r"\d+<([^>]*)>", rest)):
            inside += pid in filtered
            outside += [line] if pid not in filtered else []
    return outside, inside


with test.check("no process reads the submitter's bytes outside of a sandbox (strace)"):
    daemon.stop()
    daemon, client = start()
    if shutil.which("strace") is None:
        print("    skipped: no strace on this machine")
    else:
        out = test.path("trace")
        tracer = subprocess.Popen(
            ["strace", "-f", "-y", "-s", "0", "-o", out, "-e",
             "trace=read,readv,pread64,preadv,mmap,copy_file_range,sendfile,seccomp,clone,clone3",
             "-p", str(daemon.process.pid)], stderr=subprocess.PIPE)
        line = tracer.stderr.readline()
        if b"attached" not in line:
            print(f"    skipped: strace may not attach here ({line.decode().strip()})")
        else:
            job = client.submit({"a.glb": scene}, "a.glb", WHO["ann"], resolution=256, sun="80,30",
                                verify=1000).job
            assert client.finished_job(job, WHO["ann"]).state == B.JOB_DONE
            tracer.send_signal(signal.SIGINT)
            tracer.communicate(timeout=60)
            outside, inside = unsandboxed_readers(
                open(out, encoding="utf-8", errors="replace").read(),
                lambda path: path.startswith((os.path.join(JOBS, "bundles"),
                                              os.path.join(JOBS, "incoming"),
                                              "/memfd:umbrage-scene")))
            assert outside == [], outside[:4]
            assert inside >= 2, "the importer's and the bake's reading was not seen"

# A filter made here imitates an old kernel, without landlock_create_ruleset.
OLD_KERNEL = test.path("old-kernel")
with open(OLD_KERNEL, "w", encoding="ascii") as file:
    file.write("""
import ctypes, os, struct, sys
libc = ctypes.CDLL(None)
code = b"".join(struct.pack("<HBBI", *line) for line in (
    (0x20, 0, 0, 0), (0x15, 0, 1, 444), (6, 0, 0, 0x50000 | 38), (6, 0, 0, 0x7fff0000)))
buffer = ctypes.create_string_buffer(code)
class Program(ctypes.Structure):
    _fields_ = [("count", ctypes.c_ushort), ("code", ctypes.c_void_p)]
program = Program(4, ctypes.cast(buffer, ctypes.c_void_p))
assert libc.prctl(38, 1, 0, 0, 0) == 0 and libc.prctl(22, 2, ctypes.byref(program)) == 0
os.execv(sys.argv[1], sys.argv[1:])
""")

with test.check("a kernel without a layer is refused, and said, or taken at the operator's word"):
    def bake_on_old_kernel(*words):
        return subprocess.run([sys.executable, OLD_KERNEL, ut.program("umbrage-bake"), *words],
                              capture_output=True, timeout=60, check=False)

    plan = (scene_path, "--plan", "--resolution", "64")
    done = bake_on_old_kernel(*plan, "--sandbox", "required")
    assert done.returncode == 69 and b"Landlock" in done.stderr, done
    assert b"--sandbox available" in done.stderr and b"--job-sandbox" in done.stderr, done
    done = bake_on_old_kernel(*plan, "--sandbox", "available")
    assert done.returncode == 0 and b"a layer is missing (Landlock no" in done.stderr, done
    assert bake_on_old_kernel("doctor", "--quiet").returncode == 69
    assert bake_on_old_kernel(*plan, "--quiet", "--sandbox", "off").stderr == b""

with test.check("jobs on such a kernel fail with the cause, or are baked at the operator's word"):
    old_bake = test.path("old-bake")
    with open(os.open(old_bake, os.O_WRONLY | os.O_CREAT, 0o755), "w", encoding="ascii") as file:
        file.write(f"#!/bin/sh\nexec '{sys.executable}' '{OLD_KERNEL}' "
                   f"'{ut.program('umbrage-bake')}' \"$@\"\n")
    for sandbox in ((), ("--job-sandbox", "available")):
        daemon.stop()
        daemon, client = start("--bake-program", old_bake, *sandbox)
        job = client.submit({"a.glb": scene}, "a.glb", WHO["bob"], resolution=256, verify=1000,
                            sun=f"7{len(sandbox)},40").job
        status = client.finished_job(job, WHO["bob"])
        if sandbox:
            assert status.state == B.JOB_DONE and "a layer is missing" in status.notices, status
        else:
            assert status.state == B.JOB_FAILED, status
            assert "Landlock" in status.cause and "--job-sandbox" in status.cause, status

test.finish()
