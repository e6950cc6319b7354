#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
coverage_table.py BUILD: lines and branches that ran, by folder, and the ten files with the lowest
share of branches. `make coverage` runs it after its tests.

A branch is one of the two ways out of a conditional jump in the code that gcc makes at -O0: an `if`
has two branches, and each operand of && and || has two more. All branches count, also those of
failed allocations and of assertions. An object that several programs link has one set of counts; a
source that is compiled twice (the interop daemon) has the sum of both. Tests and generated code do
not count.
"""
import collections
import concurrent.futures
import glob
import json
import os
import subprocess
import sys

FOLDERS = ("server/", "client/", "proto/")
SMALL = 60  # branches; files with fewer are not among the lowest
LOWEST = 10


def counts_of(notes):
    """[(source, [(line, count, [branch counts])])] of one object."""
    done = subprocess.run(["gcov", "--branch-probabilities", "--json-format", "--stdout", notes],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
    found = []
    for text in done.stdout.decode(errors="replace").splitlines():
        if text.startswith("{"):
            found += [(file["file"], [(line["line_number"], line["count"],
                                       [branch["count"] for branch in line["branches"]])
                                      for line in file["lines"]])
                      for file in json.loads(text)["files"] if file["file"].startswith(FOLDERS)]
    return found


def merged(objects):
    """{source: {line: [count, [branch counts]]}}"""
    sources = {}
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(counts_of, objects):
            for name, lines in found:
                source = sources.setdefault(name, {})
                for number, count, branches in lines:
                    entry = source.setdefault(number, [0, []])
                    entry[0] += count
                    entry[1] += [0] * (len(branches) - len(entry[1]))
                    for i, branch in enumerate(branches):
                        entry[1][i] += branch
    return sources


def totals_of(lines):
    """(lines that ran, lines, branches that were taken, branches)"""
    branches = [count for _, counts in lines.values() for count in counts]
    return (sum(1 for count, _ in lines.values() if count), len(lines),
            sum(1 for count in branches if count), len(branches))


def folder_of(name):
    """client/core and server/bake have many folders: each of these counts by itself."""
    parts = name.split("/")
    deep = name.startswith(("client/core", "server/bake")) and len(parts) > 3
    return "/".join(parts[:3 if deep else 2])


def share(part, whole):
    return f"{100 * part / whole:6.1f} %" if whole else "      - "


def row(name, totals):
    ran, lines, taken, branches = totals
    return (f"{name:38s} {ran:6d} of {lines:6d} lines {share(ran, lines)} "
            f"{taken:6d} of {branches:6d} branches {share(taken, branches)}")


def main():
    objects = [path for path in glob.glob(os.path.join(sys.argv[1], "**", "*.gcno"), recursive=True)
               if "/tests/" not in path]
    files = {name: totals_of(lines) for name, lines in merged(objects).items()}
    if not files:
        raise SystemExit(f"{sys.argv[1]}: holds no counts of a build with --coverage")
    folders = collections.defaultdict(lambda: [0, 0, 0, 0])
    for name, totals in files.items():
        for sums in folders[folder_of(name)], folders["all"]:
            for i, number in enumerate(totals):
                sums[i] += number
    for name in sorted(folders, key=lambda name: (name == "all", name)):
        print(row(name, folders[name]))
    print(f"\nlowest share of branches, of files with over {SMALL}:")
    known = [(totals[2] / totals[3], name) for name, totals in files.items()
             if totals[3] > SMALL and not name.endswith(".h")]
    for _, name in sorted(known)[:int(os.environ.get("LOWEST", LOWEST))]:
        print(row(name, files[name]))


main()
