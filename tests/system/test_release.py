#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
What a release needs of the tree: `make version` sets the version everywhere and refuses what is not one; make refuses
another version than the header's; a tree builds in a folder whose name has spaces, and no object names that folder.
"""
import os
import re
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

if shutil.which("git") is None:
    ut.skip("git is not installed")
test = ut.Test()
TREE = test.path("a tree with spaces")
HEADER, CHANGELOG = "client/include/umbrage/version.h", "docs/CHANGELOG.md"
SYMBOLS, PAGE = "deploy/debian/libumbrage1.symbols", "docs/results/queries.md"
for part in ("Makefile", "client", "proto", "server", "deploy", "tests/module.mk", "docs/CHANGELOG.md", "docs/results"):
    place = os.path.join(TREE, part)
    os.makedirs(os.path.dirname(place), exist_ok=True)
    (shutil.copytree if os.path.isdir(os.path.join(ut.ROOT, part)) else shutil.copy)(os.path.join(ut.ROOT, part), place)


def run(*words):
    clean = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "GIT")) and key not in ("BUILD", "config")}
    return subprocess.run(words, cwd=TREE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, env=clean)


def git(*words):
    done = run("git", "-c", "user.name=test", "-c", "user.email=test@localhost", *words)
    assert done.returncode == 0, done.stdout
    return done.stdout


def read(name):
    with open(os.path.join(TREE, name), encoding="utf-8") as file:
        return file.read()


def write(name, text):
    with open(os.path.join(TREE, name), "w", encoding="utf-8") as file:
        file.write(text)


def version(*words):
    return run(sys.executable, "deploy/version.py", *words)


git("init", "-q")
# The test starts from a first release under way, wherever the tree stands.
OLD = "0.1.0"
write(HEADER, re.sub(r"(UMB_VERSION_MAJOR) \d+", r"\1 0", re.sub(r"(UMB_VERSION_MINOR) \d+", r"\1 1", re.sub(
    r"(UMB_VERSION_PATCH) \d+", r"\1 0", read(HEADER)))))
write(CHANGELOG, f"# Changelog\n\n## {OLD} (unreleased)\n\nBefore {OLD}; not 10.1.0 or 0.1.0.1.\n")
write(SYMBOLS, re.sub(r"(@UMBRAGE_1) \S+", rf"\1 {OLD}", read(SYMBOLS)))
write(PAGE, f"Figures of release {OLD}.\n")

with test.check("what is no version, no later one, or no day is refused, and nothing is changed"):
    for words, said in ((("1.0",), "'1.0'"), (("",), "''"), (("01.0.0",), "'01.0.0'"), (("1.100.0",), "'1.100.0'"), (("1.0.0-rc",), "1.0.0-rc"),
                        (("1.0.0", "2026-13-01"), "DATE: '2026-13-01'"), (("1.0.0", "today"), "DATE: 'today'")):
        done = version(*words)
        assert done.returncode != 0 and said in done.stdout, (words, done.stdout)
    assert OLD in read(CHANGELOG) and f"release {OLD}" in read(PAGE)

with test.check("the first release has its version in every place"):
    done = version("1.0.0", "2026-11-30")
    assert done.returncode == 0, done.stdout
    assert "".join(re.findall(r"UMB_VERSION_(?:MAJOR|MINOR|PATCH) (\d)", read(HEADER))) == "100"
    assert read(CHANGELOG) == "# Changelog\n\n## 1.0.0 (2026-11-30)\n\nBefore 1.0.0; not 10.1.0 or 0.1.0.1.\n"
    assert set(re.findall(r"@UMBRAGE_1 (\S+)", read(SYMBOLS))) == {"1.0.0"} and read(PAGE) == "Figures of release 1.0.0.\n"
    done = version("1.0.1")
    assert done.returncode != 0 and "unreleased" in done.stdout, done.stdout

with test.check("a later release leaves what was released, and gives new functions its version"):
    git("add", "-A")
    git("commit", "-q", "-m", "release: 1.0.0")
    git("tag", "v1.0.0")
    write(CHANGELOG, read(CHANGELOG).replace("# Changelog\n", "# Changelog\n\n## 1.1.0 (unreleased)\n\n- more\n"))
    write(SYMBOLS, read(SYMBOLS) + " umb_new@UMBRAGE_1 1.0.0\n")
    done = version("1.0.0")
    assert done.returncode != 0 and "tagged" in done.stdout, done.stdout
    done = version("1.1.0", "2027-02-28")
    assert done.returncode == 0, done.stdout
    assert "## 1.1.0 (2027-02-28)" in read(CHANGELOG) and "## 1.0.0 (2026-11-30)" in read(CHANGELOG)
    assert read(SYMBOLS).count(" 1.1.0\n") == 1 and " umb_new@UMBRAGE_1 1.1.0\n" in read(SYMBOLS)
    assert read(PAGE) == "Figures of release 1.0.0.\n"

with test.check("make takes the header's version, and refuses another"):
    assert "umbrage-1.1.0.tar.gz" in run("make", "-n", "dist").stdout
    assert run("make", "-n", "dist", "VERSION=1.1.0").returncode == 0
    done = run("make", "-n", "dist", "VERSION=1.2.0")
    assert done.returncode != 0 and "make version VERSION=1.2.0" in done.stdout, done.stdout
    done = run("make", "version")
    assert done.returncode != 0 and "VERSION: ''" in done.stdout, done.stdout

with test.check("a release is made of a commit: files that differ from it are named as the reason"):
    done = run("make", "release")
    assert done.returncode != 0 and "differ from the last commit" in done.stdout, done.stdout

with test.check("a tree builds in a folder whose name has spaces, and no object names that folder"):
    for build in ("build/release", "./build/release", os.path.join(TREE, "build/release")):
        done = run("make", f"BUILD={build}", "build/release/client/core/base/version.o")
        assert done.returncode == 0, done.stdout
    with open(os.path.join(TREE, "build/release/client/core/base/version.o"), "rb") as file:
        assert b"with spaces" not in file.read()
    done = run("make", "BUILD=a b", "all")
    assert done.returncode != 0 and "BUILD: 'a b'" in done.stdout, done.stdout

test.finish()
