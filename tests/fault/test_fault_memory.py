#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Out of memory is an answer, never a crash. The n-th allocation fails, once or from then on:

- programs on files, the planner with its importer, and clients of a daemon end with their usual
  output and code 0, or with code 75 and one sentence on stderr; what they printed before that is a
  beginning of the usual output, and no output file or temporary appears;
- a daemon that starts ends with code 75 and a sentence, or lives and answers right once it has
  scanned its store again;
- a daemon that serves answers the call right, refuses it as exhausted, or drops the connection; the
  next call, with memory, is answered right.
"""
import os
import shutil
import signal
import subprocess
import time

import fault_sweep as fs
from fault_sweep import ut

test = ut.Test(limit_s=2400)
sweep = fs.Sweep(test)
SEED = 3
print(f"seed {SEED}")

out = test.path("out")
scene = test.scene("city", 2, form="ply")
store = test.path("store")
asset = os.path.join(store, "city.umb")
os.mkdir(store)
test.bake(scene, asset, "--resolution", 256, "--verify", 0)
mapped = test.path("city.umbm")
ut.run("umbrage", "unpack", asset, "-o", mapped)
values = ut.random_points((-100, -100, -10), (100, 100, 80), 300, SEED)
points = test.path("points")
with open(points, "w", encoding="ascii") as points_file:
    for i in range(0, len(values), 3):
        points_file.write("%.9g %.9g %.9g\n" % tuple(values[i:i + 3]))
QUERY = ["--points", points, "--taps", 3, "--quiet"]


# libuv 1.44 aborts if the table of its descriptors cannot grow (uv__io_start), which a new loop
# does at once. Only libuv could prevent that, so one call may end in this way, and in no other.
LIBUV_ABORTS = 1
START_ABORTS = 2  # a daemon's table grows twice while it starts
start_aborts = set()


def sweep_program(words, codes=(75,), env=None, output=None, aborts=0):
    """Fails each allocation of one program, once and from then on."""
    aborted = set()
    failures = fs.Failures()
    whole = sweep.run(words, "memory", "ENOMEM", 0, env=env)
    assert whole.code == 0 and whole.calls > 0, str(whole)
    wanted = read(output)
    refused = 0
    limit = fs.LIMIT if fs.SHORT else 2 * fs.LIMIT
    for keep in (False, True):
        for at in sweep.points(whole.calls, limit):
            with failures.point("from" if keep else "at", "call", at):
                if read(output) is not None:
                    os.remove(output)
                end = sweep.run(words, "memory", "ENOMEM", at, keep, env=env)
                if end.code == -signal.SIGABRT and not end.err:
                    aborted.add(at)
                    assert len(aborted) <= aborts, str(end)
                    continue
                assert not end.died(), str(end)
                if end.code == 0:
                    assert end.out == whole.out, f"code 0 with other output; {end}"
                    assert read(output) == wanted, "code 0 with another file"
                else:
                    refused += 1
                    assert end.code in codes, str(end)
                    fs.one_sentence(end.err, words[0])
                    assert whole.out.startswith(end.out), f"wrong output: {end.out[:200]}"
                    assert read(output) is None, "an output in spite of the failure"
                    assert not output or not os.listdir(out), os.listdir(out)
    print(f"    {whole.calls} allocations, {failures.done} runs with a fault, {refused} refused")
    failures.end()
    assert refused > 0, "no failed allocation was noticed"


def read(path):
    if not path or not os.path.exists(path):
        return None
    with open(path, "rb") as file:
        return file.read()


os.mkdir(out)
packed_out = os.path.join(out, "o.umb")
PROGRAMS = {
    "info": ["umbrage", "info", asset],
    "info --json of a mapped file": ["umbrage", "info", mapped, "--json"],
    "query of a packed file": ["umbrage", "query", asset] + QUERY,
    "query of a mapped file": ["umbrage", "query", mapped] + QUERY,
    "verify": ["umbrage", "verify", asset],
}
for name, words in PROGRAMS.items():
    with test.check(f"umbrage {name} ends right or with 75"):
        sweep_program(words)
with test.check("umbrage pack ends right or with 75"):
    sweep_program(["umbrage", "pack", mapped, "-o", packed_out, "--quiet"], output=packed_out)
with test.check("umbrage unpack ends right or with 75"):
    sweep_program(["umbrage", "unpack", asset, "-o", packed_out, "--quiet"], output=packed_out)
for form in ("ply", "obj", "glb"):
    with test.check(f"umbrage-bake --plan of {form} ends right or with 75"):
        sweep_program(["umbrage-bake", test.scene("city", 2, form=form), "--plan", "--quiet"])


# ---- the daemon ----

with open(points, "rb") as points_file:
    answers = ut.run("umbrage", "query", asset, *QUERY).stdout


def ask(socket):
    """Exit code, stdout and stderr of a client; a hang is an error."""
    command = [ut.program("umbrage"), "query", "city", "--address", "unix:" + socket] + \
        [str(word) for word in QUERY]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, timeout=fs.HANG_S, check=False)
    except subprocess.TimeoutExpired:
        raise AssertionError(f"the client waits for more than {fs.HANG_S} s") from None
    return done.returncode, done.stdout, done.stderr


def answered_or_refused(socket):
    """Checks an exit code. 75, or 2 with the word "memory": RESOURCE_EXHAUSTED (from the code alone
    the client cannot tell a limit that the request broke from lack of memory). 69: the connection
    was dropped. 70: the stream was reset, because there was no memory for a reply's headers. A
    wrong answer is never allowed."""
    code, text, err = ask(socket)
    if code == 0:
        assert text == answers, "a wrong answer"
    else:
        assert (code in (75, 69) or (code == 2 and b"out of memory" in err) or
                (code == 70 and b"the server reset the call" in err)), f"code {code}, {err!r}"
        fs.one_sentence(err, "umbrage")
    return code


def answers_right(socket):
    code, text, err = ask(socket)
    assert code == 0 and text == answers, f"with memory again: code {code}, {err!r}"


def serve(keep):
    """Fails each allocation of a serving daemon during one call; the next call is answered."""
    codes = {}
    failures = fs.Failures()
    with sweep.injected("memory", "ENOMEM") as board:
        daemon = test.daemon("--workers", 1)
    answers_right(daemon.socket_path)
    before = board.calls
    answers_right(daemon.socket_path)
    count = board.calls - before
    for at in sweep.points(count + count // 4, 6 if fs.SHORT else fs.LIMIT):
        with failures.point("from" if keep else "at", "call", at):
            now = board.calls
            board.fail(now + at, fs.KEEP if keep else now + at)
            code = answered_or_refused(daemon.socket_path)
            board.fail(0, 0)
            codes[code] = codes.get(code, 0) + 1
            assert daemon.process.poll() is None, f"it died: {daemon.process.poll()}"
            answers_right(daemon.socket_path)
        board.fail(0, 0)
        if daemon.process.poll() is not None:
            break
    print(f"    {count} allocations a call, {failures.done} runs with a fault, client's codes "
          f"{dict(sorted(codes.items()))}")
    daemon.stop()
    test.daemons.remove(daemon)
    failures.end()
    assert set(codes) != {0}, "no failed allocation was noticed"


def launch(at, keep):
    """A daemon on a store without cache; returns it once it listens or is over, and the board."""
    shutil.rmtree(os.path.join(store, ".umbrage-cache"), ignore_errors=True)
    sweep.runs += 1
    socket = test.path("s.sock")
    with sweep.injected("memory", "ENOMEM", at=at, keep=keep) as board:
        process = subprocess.Popen([ut.program("umbraged"), "--store", store, "--listen",
                                    "unix:" + socket, "--workers", "1", "--drain-delay", "0"],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    deadline = time.monotonic() + fs.HANG_S
    while process.poll() is None and not os.path.exists(socket):
        if time.monotonic() > deadline:
            process.kill()
            process.wait()
            raise AssertionError("it neither starts nor ends")
        time.sleep(0.002)
    return process, board, socket


def answers_in_time(process, socket):
    """Asks until the daemon answers right; False if it ended before."""
    deadline = time.monotonic() + fs.HANG_S
    while process.poll() is None:
        code, text, err = ask(socket)
        if code == 0:
            assert text == answers, "a wrong answer"
            return True
        assert time.monotonic() < deadline, f"it never answers: code {code}, {err!r}"
        if code != 69 and process.poll() is None:
            process.send_signal(signal.SIGHUP)  # what could not be loaded is tried again
        time.sleep(0.01)
    return False


def start(at, keep):
    """A daemon whose start meets the fault. Returns True if it gave up."""
    process, board, socket = launch(at, keep)
    try:
        if process.poll() is None and keep:
            time.sleep(0.02)  # it may end yet, or go on without memory
            board.fail(0, 0)
        lives = answers_in_time(process, socket)
        if lives:
            process.send_signal(signal.SIGTERM)
        err = process.communicate(timeout=fs.HANG_S)[1].decode(errors="replace")
        code = process.returncode
        if lives:
            assert code == 0, f"exit code {code}: {err[-600:]}"
        elif code == -signal.SIGABRT:
            start_aborts.add(at)
            assert len(start_aborts) <= START_ABORTS, f"aborted at {sorted(start_aborts)}"
        else:
            said = [line for line in err.splitlines() if line.startswith("umbraged: ")]
            assert len(said) == 1, f"not one sentence: {err[-600:]}"
            # 69: the daemon cannot listen, and says that memory is short.
            assert code == 75 or (code == 69 and "not enough memory" in said[0]), \
                f"exit code {code}: {err[-600:]}"
        return not lives
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


started = test.daemon("--workers", 1)
socket_path = started.socket_path
for name in (["list"], ["info", "city"], ["query", "city"] + QUERY):
    with test.check(f"umbrage {name[0]} of a daemon ends right or with 75"):
        # 69: the connection was lost because memory for it was short.
        sweep_program(["umbrage"] + name, codes=(75, 69), aborts=LIBUV_ABORTS,
                      env={"UMBRAGE_ADDRESS": "unix:" + socket_path})
started.stop()
test.daemons.remove(started)

for again in (False, True):
    how = "from then on" if again else "once"
    with test.check(f"a serving daemon without memory, {how}, refuses and recovers"):
        serve(again)
    with test.check(f"a starting daemon without memory, {how}, gives up or recovers"):
        starts = fs.Failures()
        given_up = 0
        undisturbed, start_board, _ = launch(0, False)
        allocations = start_board.calls
        undisturbed.terminate()
        assert undisturbed.wait(fs.HANG_S) == 0, undisturbed.communicate()
        assert allocations > 0, "the daemon started without memory"
        for number in sweep.points(allocations, fs.LIMIT if fs.SHORT else 200):
            with starts.point("call", number):
                given_up += start(number, again)
        print(f"    {allocations} allocations, {starts.done} starts, {given_up} gave up")
        starts.end()

test.finish()
