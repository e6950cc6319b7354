#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Proves the legend of prefixes (docs/ARCHITECTURE.md).

- A name with the public prefix (umb_, UMB_) is declared in an installed header.
- UMB_API stands in installed headers alone.
- What a header of a folder declares bears the folder's prefix.
"""
import os
import re
import subprocess
import sys

PUBLIC = "client/include"
PREFIXES = {  # folder: its prefix; two underscores more for what one folder keeps to itself
    "client/core": "umb__", "client/rpc": "umb__", "client/tool": "umbu_", "client/cli": "umbc_", "client/web": "umbx_", "client/load": "umbc_",
    "proto/grpc": "umbw_", "proto/wire": "umbw_", "proto/net": "umbn_", "server/common": "umbs_", "server/scene": "umbs_",
    "server/store": "umbs_", "server/jobs": "umbj_", "server/rays": "umbr_", "server/bake": "umbb_",
    "server/daemon": "umbd_", "server/study": "umbt_",
}
# Macros that a build sets, and the X-macros' stems.
SET_BY_BUILDS = re.compile(r"UMB_(WITHOUT_|BENCH_)|UMB_(MAP|E)_$")
QUOTED = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:[^"\\\n]|\\.)*"', re.S)
DECLARED = re.compile(r"^(?:typedef .*\(\*|(?:struct|enum|union) (?=\w+ \{)|#define |[A-Za-z_].*?[ *](?=\w+\())(umb\w+)",
                      re.M | re.I)


def sources(*patterns):
    done = subprocess.run(["git", "ls-files", *patterns], stdout=subprocess.PIPE, check=True, text=True)
    return [path for path in done.stdout.split() if os.path.isfile(path)]


def code(path):
    """A file without comments and strings, line numbers kept."""
    with open(path, encoding="utf-8") as file:
        return QUOTED.sub(lambda match: "\n" * match.group().count("\n"), file.read())


def public_names():
    names = set()
    for path in sources(f"{PUBLIC}/*.h"):
        text = code(path)
        names.update(re.findall(r"\b(?:umb|UMB)_\w+", text))
        if "UMB_STATUS_LIST" in text:
            names.update("UMB_" + name for name in re.findall(r"X\((\w+),", text))
    return names


def main():
    faults = []
    public = public_names()
    for path in sources("client/*.[ch]", "proto/*.[ch]", "server/*.[ch]"):
        if path.startswith(PUBLIC):
            continue
        text = code(path)
        for match in re.finditer(r"\b(?:umb|UMB)_(?!_)\w+", text):
            name, line = match.group(), text.count("\n", 0, match.start()) + 1
            if name == "UMB_API" or (name not in public and not SET_BY_BUILDS.match(name)):
                faults.append(f"{path}:{line}: {name} has the public prefix, and no installed header declares it")
        folder = next((folder for folder in PREFIXES if path.startswith(folder + "/")), None)
        if folder is None or not path.endswith(".h"):
            continue
        for match in DECLARED.finditer(text):
            name, prefix = match.group(1), PREFIXES[folder]
            if name not in public and not name.lower().startswith(prefix) and not name.startswith("UMBRAGE_"):
                faults.append(f"{path}:{text.count(chr(10), 0, match.start()) + 1}: {name} does not begin with {prefix}")
    for fault in sorted(set(faults)):
        print(fault)
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
