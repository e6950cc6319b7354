#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
run_mutants.py [--short] [--jobs N] [--table FILE] [NAME...]: removes guards from the program, one at
a time, and runs the tests that must then fail. A mutant with no failed test (a survivor) is a guard
without a test.

The table (mutants.toml beside this file) has a block for each mutant:

    [[mutant]]
    name = "page-hash"
    file = "client/core/partial/partial_pages.c"
    old = '''return memcmp(hash, '''           # stands exactly once in the file
    new = '''return 1 || memcmp(hash, '''
    tests = ["unit/core/test_partial_hostile", "system/test_paging.py"]
    short = true                                # also in the short form (optional)

Tests are named below tests/: a unit test as its program, a script with its ending; the cheapest
comes first, since the first that fails ends the row. Names may hold * and ?.

All work is done in copies of the tree below build/mutants, one for each job, which begin with what
build/release holds; each mutant compiles and links only what its file touches. First the tests named
must pass without a mutant.
Exit codes: 0 every mutant was noticed; 1 not; 2 the table or the tests as they are cannot be used.
"""
import argparse
import concurrent.futures
import fnmatch
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
WORK = os.path.join(ROOT, "build", "mutants")
BUILD = "build/release"
PROGRAMS = [f"{BUILD}/{name}" for name in ("umbrage", "umbraged", "umbrage-bake", "umbrage-study", "scenegen")]
# A mutant may leave names unused: that is no error.
MAKE = ["make", "--no-print-directory", "config=release", f"BUILD={BUILD}", "werror=", "CFLAGS=-w"]
SKIP, TIMED_OUT = 77, 124
SHORTEST_LIMIT_S, SLOWER = 20, 10  # of a test: so many times what it takes without a mutant
FIELDS = {"name": str, "file": str, "old": str, "new": str, "tests": list}

printing = threading.Lock()


class Unusable(Exception):
    """The table, or the tests without a mutant."""


def say(text):
    with printing:
        print(text, flush=True)


def is_script(test):
    return test.endswith((".py", ".sh"))


def find_tests(pattern, row):
    """Tests of that name, as paths of a tree."""
    folder, name = os.path.split(os.path.join("tests", pattern))
    ending = "" if is_script(name) else ".c"
    there = os.listdir(os.path.join(ROOT, folder)) if os.path.isdir(os.path.join(ROOT, folder)) else []
    found = sorted(fnmatch.filter(there, name + ending))
    if not found:
        raise Unusable(f"{row}: there is no test '{pattern}'")
    paths = [os.path.join(folder, file) for file in found]
    return [path if is_script(name) else f"{BUILD}/{path[:-2]}" for path in paths]


def check_row(row, names):
    for field, kind in FIELDS.items():
        if not isinstance(row.get(field), kind) or not row[field] and field != "new":
            raise Unusable(f"{row.get('name', row)}: field '{field}' is missing or empty")
    if row["name"] in names:
        raise Unusable(f"{row['name']}: stands twice")
    names.add(row["name"])
    try:
        with open(os.path.join(ROOT, row["file"]), encoding="utf-8") as file:
            count = file.read().count(row["old"])
    except OSError as error:
        raise Unusable(f"{row['name']}: {error}") from error
    if count != 1:
        raise Unusable(f"{row['name']}: its old text stands {count} times in {row['file']}, not once")
    row["paths"] = [path for test in row["tests"] for path in find_tests(test, row["name"])]


def load_table(path, wanted, short):
    with open(path, "rb") as file:
        rows = tomllib.load(file).get("mutant", [])
    names = set()
    for row in rows:
        check_row(row, names)
    unknown = set(wanted) - names
    if unknown:
        raise Unusable(f"the table has no {', '.join(sorted(unknown))}")
    return [row for row in rows if (not wanted or row["name"] in wanted) and (not short or row.get("short"))]


def targets_of(tests):
    """What make has to make for them."""
    targets = [test for test in tests if not is_script(test)]
    if len(targets) < len(tests):
        targets += PROGRAMS
    if any(test.startswith("tests/fault/") for test in tests):
        targets.append("fault-needs")
    if "tests/system/test_job_sandbox.py" in tests:
        targets.append(f"{BUILD}/intruder.so")
    if "tests/system/test_gpu_shaders.py" in tests:
        targets += ["gpu"] + [f"{BUILD}/{program}" for program in ("scenegen", "gpu_voxels", "gpu_answers")]
    return sorted(set(targets))


def sources():
    words = ["git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(words, stdout=subprocess.PIPE, check=True)
    return [name for name in done.stdout.decode().split("\0") if name and os.path.isfile(os.path.join(ROOT, name))]


class Tree:
    """A copy of the sources with a build folder of its own."""

    def __init__(self, number):
        self.path = os.path.join(WORK, str(number))

    def begin(self):
        """A first copy, with times as they are, so that what was built stays built."""
        made = os.path.join(ROOT, BUILD)
        os.makedirs(self.path)
        for name in sources():
            os.makedirs(os.path.dirname(os.path.join(self.path, name)), exist_ok=True)
            shutil.copy2(os.path.join(ROOT, name), os.path.join(self.path, name))
        if os.path.isdir(made):
            os.makedirs(os.path.join(self.path, "build"))
            subprocess.run(["cp", "-a", made, os.path.join(self.path, BUILD)], check=True)

    def update(self):
        """Makes the sources those of the tree; a file that is equal keeps its time."""
        if not os.path.isdir(self.path):
            self.begin()
        names = sources()
        for name in names:
            self.copy(name)
        kept = {os.path.join(self.path, name) for name in names}
        for folder, folders, files in os.walk(self.path):
            if folder == self.path:
                folders[:] = [f for f in folders if f != "build"]
            for file in files:
                if os.path.join(folder, file) not in kept:
                    os.unlink(os.path.join(folder, file))

    def copy(self, name):
        source, target = os.path.join(ROOT, name), os.path.join(self.path, name)
        with open(source, "rb") as file:
            data = file.read()
        if os.path.exists(target):
            with open(target, "rb") as file:
                if file.read() == data:
                    return
        os.makedirs(os.path.dirname(target), exist_ok=True)
        shutil.copyfile(source, target)
        shutil.copymode(source, target)

    def make(self, targets, jobs):
        """None, or what the compiler says."""
        done = subprocess.run(MAKE + [f"-j{jobs}"] + targets, cwd=self.path, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, check=False)
        return None if done.returncode == 0 else done.stdout.decode(errors="replace")[-2000:]

    def run(self, test, limit_s):
        """Exit code, seconds, output."""
        begin = time.monotonic()
        env = {**os.environ, "BUILD": BUILD, "FAULT": "short"}
        process = subprocess.Popen([os.path.join(".", test)], cwd=self.path, env=env,
                                   stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, start_new_session=True)
        try:
            output, _ = process.communicate(timeout=limit_s)
            code = process.returncode
        except subprocess.TimeoutExpired:
            code = TIMED_OUT
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        if code == TIMED_OUT:
            output, _ = process.communicate()
        return code, time.monotonic() - begin, output.decode(errors="replace")

    def change(self, row):
        path = os.path.join(self.path, row["file"])
        with open(path, encoding="utf-8") as file:
            text = file.read()
        with open(path, "w", encoding="utf-8") as file:
            file.write(text.replace(row["old"], row["new"]))


def make_trees(count):
    trees = [Tree(number) for number in range(count)]
    for tree in trees:
        tree.update()
    return trees


def build(trees, targets, jobs):
    """Builds the first tree, and copies the result to trees that have nothing yet."""
    for tree in trees:
        if tree != trees[0] and not os.path.isdir(os.path.join(tree.path, "build")):
            subprocess.run(["cp", "-a", trees[0].path + "/.", tree.path], check=True)
        said = tree.make(targets, jobs)
        if said is not None:
            raise Unusable(f"the tree as it is does not build:\n{said}")


def run_unchanged(tree, tests, jobs):
    """Seconds of each test without a mutant; None for one that is skipped here."""
    seconds, failed = {}, []

    def one(test):
        code, took, output = tree.run(test, 600)
        seconds[test] = None if code == SKIP else took
        if code not in (0, SKIP):
            failed.append((test, f"{test} fails without a mutant (exit {code}):\n{output[-2000:]}"))

    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        list(pool.map(one, tests))
    again, failed[:] = [test for test, _ in failed], []
    for test in again:  # by itself: it may mind a busy machine
        one(test)
    if failed:
        raise Unusable("\n".join(said for _, said in failed))
    return seconds


def try_mutant(tree, row, seconds):
    """'noticed', 'survived', 'skipped' or 'unusable', and a sentence."""
    tests = [test for test in row["paths"] if seconds[test] is not None]
    if not tests:
        return "skipped", "all of its tests are skipped on this machine"
    tree.change(row)
    try:
        for test in tests:  # each is built when it is its turn: the first usually ends the row
            said = tree.make(targets_of([test]), 1)
            if said is not None:
                return "unusable", f"does not build: {said[-600:]}"
            code, took, _ = tree.run(test, max(SHORTEST_LIMIT_S, SLOWER * seconds[test]))
            if code not in (0, SKIP):
                how = "time-out" if code == TIMED_OUT else f"exit {code}"
                return "noticed", f"by {test} ({how}, {took:.0f} s)"
        return "survived", "not noticed by " + ", ".join(tests)
    finally:
        tree.copy(row["file"])


def run_rows(trees, rows, seconds):
    free = queue.Queue()
    for tree in trees:
        free.put(tree)
    counts = {"noticed": 0, "survived": 0, "skipped": 0, "unusable": 0}

    def one(row):
        tree, begin = free.get(), time.monotonic()
        try:
            verdict, sentence = try_mutant(tree, row, seconds)
        finally:
            free.put(tree)
        counts[verdict] += 1
        word = verdict if verdict == "noticed" else verdict.upper()
        say(f"{row['name']:<24} {word} {sentence} [{time.monotonic() - begin:.0f} s]")

    with concurrent.futures.ThreadPoolExecutor(len(trees)) as pool:
        list(pool.map(one, rows))
    return counts


def main():
    cores = os.cpu_count() or 1
    parser = argparse.ArgumentParser(description="Takes guards out one at a time.")
    parser.add_argument("--short", action="store_true", help="only rows marked short")
    parser.add_argument("--jobs", type=int, default=cores, help="mutants at once (default: processors)")
    parser.add_argument("--table", default=os.path.join(HERE, "mutants.toml"))
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these rows")
    words = parser.parse_args()
    begin = time.monotonic()
    try:
        rows = load_table(words.table, words.names, words.short)
        tests = sorted({test for row in rows for test in row["paths"]})
        trees = make_trees(max(1, min(words.jobs, len(rows))))
        build(trees, targets_of(tests), cores)
        seconds = run_unchanged(trees[0], tests, words.jobs)
        say(f"{len(tests)} tests pass without a mutant ({time.monotonic() - begin:.0f} s)")
        counts = run_rows(trees, rows, seconds)
    except Unusable as error:
        print(f"mutants: {error}", file=sys.stderr)
        return 2
    print(f"{len(rows)} mutants in {time.monotonic() - begin:.0f} s: {counts['noticed']} noticed, "
          f"{counts['survived']} survived, {counts['skipped']} skipped, {counts['unusable']} unusable")
    return 0 if counts["noticed"] + counts["skipped"] == len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
