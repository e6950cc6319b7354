#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Finds call circles among the object files of a build (docs/ARCHITECTURE.md).

An object file calls another if it needs a global symbol that only the other defines. Vector variants
(X_avx2.o, X_avx512.o) are one unit with their plain twin X.o. A circle is a set of units each of which
reaches every other one.

    circles.py [--build DIR] [FOLDER ...]    circles within the folders, all of the product by default

Prints each circle of files, then each circle of folders, with the symbols that make it. Exit status: 0 without
a circle, 1 with one.
"""
import argparse
import collections
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PARTS = ("client/", "proto/", "server/")
VARIANT = re.compile(r"_avx(2|512)$")


def objects(build):
    """Objects whose source is in the tree: a build folder keeps those of deleted files."""
    for folder, _, names in os.walk(build):
        for name in names:
            path = os.path.join(folder, name)
            source = os.path.relpath(path, build)[:-2]
            if name.endswith(".o") and source.startswith(PARTS) and any(
                    os.path.isfile(os.path.join(ROOT, source + ending)) for ending in (".c", ".cc")):
                yield source, path


def symbols(paths):
    """For each object file the global symbols that it defines, and those that it needs."""
    done = subprocess.run(["nm", "-A", "-g", *paths], stdout=subprocess.PIPE, check=True, text=True)
    for line in done.stdout.splitlines():
        path, rest = line.split(".o:", 1)
        kind, name = rest.split()[-2:]
        yield path + ".o", kind, name


def graph_of(build):
    unit_of = {path: VARIANT.sub("", source) for source, path in objects(build)}
    if not unit_of:
        raise SystemExit(f"circles: no objects below {build}: build first")
    defined, needed = collections.defaultdict(set), []
    for path, kind, name in symbols(sorted(unit_of)):
        if kind in "Uw":
            needed.append((unit_of[path], name))
        else:
            defined[name].add(unit_of[path])
    graph = collections.defaultdict(lambda: collections.defaultdict(set))
    for unit, name in needed:
        owners = defined.get(name, ())
        if len(owners) == 1:
            owner = next(iter(owners))
            if owner != unit:
                graph[unit][owner].add(name)
    return graph, set(unit_of.values())


def circles_of(graph, units):
    """Strongly connected components of more than one unit (Tarjan's algorithm, without recursion)."""
    index, low, stack, held, found = {}, {}, [], set(), []
    for root in sorted(units):
        if root in index:
            continue
        work = [(root, iter(sorted(graph.get(root, {}))))]
        index[root] = low[root] = len(index)
        stack.append(root)
        held.add(root)
        while work:
            unit, rest = work[-1]
            following = next((to for to in rest if to in units), None)
            if following is None:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[unit])
                if low[unit] == index[unit]:
                    circle = set()
                    while unit not in circle:
                        circle.add(stack.pop())
                    held -= circle
                    if len(circle) > 1:
                        found.append(circle)
            elif following not in index:
                index[following] = low[following] = len(index)
                stack.append(following)
                held.add(following)
                work.append((following, iter(sorted(graph.get(following, {})))))
            elif following in held:
                low[unit] = min(low[unit], index[following])
    return sorted(found, key=lambda circle: (-len(circle), min(circle)))


def folders_of(graph, units):
    """The same graph, of the units' folders."""
    folders = collections.defaultdict(lambda: collections.defaultdict(set))
    for unit in units:
        for to in set(graph.get(unit, ())) & units:
            if os.path.dirname(unit) != os.path.dirname(to):
                folders[os.path.dirname(unit)][os.path.dirname(to)] |= graph[unit][to]
    return folders, {os.path.dirname(unit) for unit in units}


def print_circles(what, graph, units):
    """Prints the circles of a graph; returns their number."""
    circles = circles_of(graph, units)
    for circle in circles:
        print(f"circle of {len(circle)} {what}:")
        for unit in sorted(circle):
            for to in sorted(set(graph[unit]) & circle):
                print(f"  {unit} -> {to}: {', '.join(sorted(graph[unit][to]))}")
    return len(circles)


def main():
    parser = argparse.ArgumentParser(description="call circles among the object files of a build")
    parser.add_argument("--build", default=os.environ.get("BUILD", os.path.join(ROOT, "build/release")))
    parser.add_argument("folders", nargs="*", help="folders of the tree; all of the product by default")
    arguments = parser.parse_args()
    graph, units = graph_of(arguments.build)
    if arguments.folders:
        below = tuple(folder.rstrip("/") + "/" for folder in arguments.folders)
        units = {unit for unit in units if unit.startswith(below)}
    count = print_circles("files", graph, units) + print_circles("folders", *folders_of(graph, units))
    if count == 0:
        print(f"circles: none among {len(units)} files")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
