#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The claims of docs/explained/sources.md: every command that the tables name exists and takes its
options, every make target is there, every file and every anchor of a page too.
"""
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

test = ut.Test()
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PAGE = os.path.join(ROOT, "docs", "explained", "sources.md")
PROGRAMS = ("umbrage", "umbrage-bake", "umbrage-study", "scenegen")
FOLDERS = ("client", "server", "proto", "tests", "docs")


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def claims(page):
    """Rows of the tables below the heading of the claims, as lists of cells."""
    part = page.split("## The claims of five documents", 1)[1].split("\n## ", 1)[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")]
            for line in part.splitlines() if line.startswith("|")]
    return [row for row in rows if row[0] != "claim" and not set(row[0]) <= {"-"}]


def make_targets():
    found = set()
    for folder, _, names in os.walk(ROOT):
        if "build" in folder or ".git" in folder:
            continue
        for name in names:
            if name == "Makefile" or name.endswith(".mk"):
                found.update(re.findall(r"^([a-z][a-z0-9-]*):", read(os.path.join(folder, name)), re.M))
    return found


PLACEHOLDERS = {"SCENE": "/nowhere/scene.glb", "ASSET": "/nowhere/asset.umb", "FILE": "/nowhere/asset.umb",
                "POINTS": "/nowhere/points.txt", "OUT": test.path("out.png"),
                "VIEW": "eye=0,0,0,target=1,0,0,far=9"}
NO_INPUT = 66
ABSENT = ("scene.glb", "asset.umb", "points.txt")


def check_command(words):
    """Runs a command with files that do not exist: the missing files must be its only complaint. scenegen reads
    no files, so its help is searched for the words."""
    command = [ut.program(words[0]), *(PLACEHOLDERS.get(word, word) for word in words[1:])]
    if words[0] == "scenegen":
        told = subprocess.run([command[0], "--help"], capture_output=True, text=True, timeout=60)
        assert all(word in told.stdout + told.stderr for word in words[1:] if not word.isdigit()), (words, told)
        return
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == NO_INPUT and any(name in done.stderr for name in ABSENT), (words, done.returncode, done.stderr)


ROWS = claims(read(PAGE))
SPANS = [(row[0], span) for row in ROWS for span in re.findall(r"`([^`]+)`", row[3] if len(row) > 3 else "")]

with test.check("the tables have a row for each claim, with a state and a way to check it"):
    assert len(ROWS) > 60, len(ROWS)
    for row in ROWS:
        assert len(row) == 4 and row[0] and row[1], row
        assert row[3] or "left out" in row[1] or "not" in row[1], row
with test.check("every command exists and takes its options"):
    commands = [(claim, span.split()) for claim, span in SPANS if span.split()[0] in PROGRAMS]
    assert len(commands) > 20, commands
    for claim, words in commands:
        check_command(words)
with test.check("every make target exists"):
    targets = make_targets()
    named = [span.split() for _, span in SPANS if span.startswith("make ")]
    assert len(named) > 10, named
    for words in named:
        assert words[1] in targets, words
with test.check("every file exists, and nothing else is named"):
    for claim, span in SPANS:
        first = span.split()[0]
        if first in PROGRAMS or first == "make":
            continue
        assert first.split("/")[0] in FOLDERS and os.path.exists(os.path.join(ROOT, first)), (claim, span)
with test.check("every page and every heading that a row leads to exists"):
    for row in ROWS:
        for target in re.findall(r"\]\(([^)]+)\)", " ".join(row)):
            name, _, anchor = target.partition("#")
            page = os.path.normpath(os.path.join(os.path.dirname(PAGE), name)) if name else PAGE
            assert os.path.exists(page), target
            heads = [re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-")
                     for head in re.findall(r"^#+ (.+)$", read(page), re.M)]
            assert not anchor or anchor in heads, (target, heads)
with test.check("a wrong command is found"):
    for words in (["umbrage-study", "techniques", "SCENE", "--no-such"], ["umbrage", "derive", "ASSET", "--technique", "pcf"],
                  ["umbrage", "no-such", "ASSET"]):
        try:
            check_command(words)
        except AssertionError:
            continue
        raise RuntimeError(words)
test.finish()
