#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Proves the ways through the code that docs/explained/ways.md lists, such as "A Query from socket to reply". Each
numbered file is one of the build. Each but the first calls a file before it, or is called by one
(circles.py). No way has more files than LIMITS allows. Prints the faults, nothing else.
"""
import os
import re
import sys

import circles

LIMITS = {"A Query from socket to reply": 16, "A scene from glTF to asset": 55,
          "A page from wire to answer": 16}
PAGE = os.path.join(circles.ROOT, "docs/explained/ways.md")


def way_of(text, title):
    """The files of a section's numbered list, in order."""
    section = re.search(rf"^#+ {re.escape(title)}$(.*?)(?=^#|\Z)", text, re.MULTILINE | re.DOTALL)
    return re.findall(r"^\d+\. `([^`]+)`", section.group(1), re.MULTILINE) if section else []


def faults_of(title, files, graph, units):
    if not files:
        yield f"{title}: the page has no such list"
    if len(files) > LIMITS[title]:
        yield f"{title}: {len(files)} files, at most {LIMITS[title]}"
    before = []
    for file in files:
        unit = os.path.splitext(file)[0]
        if unit not in units:
            yield f"{title}: {file} is no file of the build"
        elif before and not any(unit in graph.get(other, {}) or other in graph.get(unit, {}) for other in before):
            yield f"{title}: {file} neither calls a file before it nor is called by one"
        before.append(unit)


def main():
    with open(PAGE, encoding="utf-8") as file:
        text = file.read()
    graph, units = circles.graph_of(os.environ.get("BUILD", os.path.join(circles.ROOT, "build/release")))
    faults = [fault for title in LIMITS for fault in faults_of(title, way_of(text, title), graph, units)]
    print("\n".join(faults), end="")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
