#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Proves the include rules of docs/ARCHITECTURE.md. PARTS says which folder may include which,
LIBRARIES which folder may include which library, FLOORS in which order the files inside a folder
stand: a file includes its own floor and those below. KNOWN lists the includes that break a rule
today; a new one fails, and so does a line that nothing needs any more.
"""
import fnmatch
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SEARCHED = ["client/include", "client/core", "client", "proto", "server"]  # as in the module.mk files
INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*["<]([^">]+)[">]', re.MULTILINE)

CORE = ["client/include", "client/core"]
TOOL = [*CORE, "client/tool"]
# A part, and the parts, folders or single headers that it may include.
PARTS = {
    "client/include": [],
    "client/core": ["client/include"],
    # The module calls the public headers, and sets queries by the table of settings.
    "client/web": ["client/include", "client/core/base"],
    "proto/net": CORE,
    "proto/grpc": CORE,
    "proto/wire": [*CORE, "proto/grpc"],
    "client/rpc": [*CORE, "proto/net", "proto/grpc", "proto/wire"],
    # The toolbox of all programs.
    "client/tool": ["client/include", "client/core/base"],
    # The command is the first customer of the public headers; the load test is one of its commands.
    "client/cli": ["client/include", "client/tool", "proto/net/http1_request.h", "proto/net/http1_fields.h"],
    "client/load": ["client/include", "client/tool", "client/cli/shared"],
    "server/common": [*TOOL, "proto/net/openssl_sha256.h"],
    "server/scene": [*TOOL, "server/common"],
    "server/store": [*TOOL, "server/common"],
    # Jobs must recognise scene files in bundles, and refuse them: they see the magic of scene files
    # and nothing else of scenes.
    "server/jobs": [*TOOL, "server/common", "server/scene/scene_file.h"],
    "server/rays": [*TOOL, "server/common", "server/scene"],
    "server/bake": [*TOOL, "server/common", "server/scene", "server/rays"],
    "server/daemon": [*TOOL, "proto/net", "proto/grpc", "proto/wire", "server/common", "server/store",
                      "server/jobs"],
    "server/study": [*TOOL, "server/common", "server/scene", "server/rays"],
}

LIBRARIES = {
    "embree3/*": ["server/rays/*", "server/bake/*", "server/study/*"],
    "jansson.h": ["server/bake/import/*"],
    "png.h": ["server/bake/import/*", "server/study/*"],
    "curl/*": ["client/cli/*", "client/load/load_metrics.c"],
    "uv.h": ["client/rpc/*", "server/daemon/*"],
    "nghttp2/*": ["client/rpc/*", "server/daemon/*"],
    "openssl/*": ["proto/net/*", "client/rpc/*", "server/common/*", "server/jobs/*", "server/daemon/*",
                  "server/study/study_report.c"],  # base64
    "sqlite3.h": ["server/jobs/*"],
    "ini.h": ["server/daemon/*"],
    "intel-ipsec-mb*": ["server/common/sha256_lanes.c"],
    "protobuf-c/*": ["proto/wire/*"],
    "*pb-c.h": ["proto/wire/*"],
    "nanovdb/*": ["server/study/nanovdb_peer.cc"],
}

# Bottom floor first; a word is a folder or a file without its ending. Every file has one floor.
FLOORS = {
    "client/cli": ["shared/*", "*"],
    "client/core": ["base/*", "format/*", "query/*", "curve/*", "partial/*", "maps/*"],
    "server/bake": [
        "base/*",
        "sandbox/*",
        "import/*",
        "options/*",
        "depth/*",
        "analysis/*",
        "build/*",
        "tiles/*",
        "write/*",
        "*",
    ],
    "server/store": ["fault_guard", "asset_map", "store_record", "store_cache", "*"],
    "server/jobs": [
        "job job_place file_threads folder farm",
        "bundle staging",
        "upload job_*",
        "executor worker_process bake_try farm_bake slurm_farm status_snapshot",
        "service*",
    ],
    "server/daemon": ["base/*", "work/*", "transport/*", "call/*", "service/*", "*"],
}

# "file -> file": why it is there still.
KNOWN = {}


def sources():
    words = ["git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard", "--",
             "client", "proto", "server"]
    done = subprocess.run(words, stdout=subprocess.PIPE, check=True)
    return [name for name in done.stdout.decode().split("\0")
            if name.endswith((".c", ".h", ".cc")) and os.path.isfile(os.path.join(ROOT, name))]


def part_of(path):
    for part in PARTS:
        if path.startswith(part + "/"):
            return part
    raise SystemExit(f"layers: {path}: PARTS in tests/lint/layers.py has no rule for its folder")


def found(include, path):
    """The file in the tree that an include of `path` means, or None: a library or generated."""
    for folder in [os.path.dirname(path), *SEARCHED]:
        name = os.path.normpath(os.path.join(folder, include))
        if os.path.isfile(os.path.join(ROOT, name)):
            return name
    return None


def floor_of(path, part):
    """Number of the floor that the file stands on. Exact names go before patterns."""
    name = os.path.relpath(os.path.splitext(path)[0], part)
    for exact in (True, False):
        for number, words in enumerate(FLOORS[part]):
            for word in words.split():
                if (name == word) if exact else fnmatch.fnmatch(name, word):
                    return number
    raise SystemExit(f"layers: {path}: FLOORS in tests/lint/layers.py names no floor for it")


def fault_of(path, target):
    """What is wrong with this include, or None."""
    part, other = part_of(path), part_of(target)
    if part != other:
        allowed = any(target == one or target.startswith(one + "/") for one in PARTS[part])
        return None if allowed else f"{part} may not include {other}"
    if part in FLOORS and floor_of(target, part) > floor_of(path, part):
        floor = FLOORS[part][floor_of(target, part)]
        return f"{floor if floor != '*' else 'the top of ' + part} stands above it"
    return None


def library_fault(include, path):
    for library, folders in LIBRARIES.items():
        if fnmatch.fnmatch(include, library) and not any(fnmatch.fnmatch(path, folder) for folder in folders):
            return f"only {' '.join(folders)} may include {library}"
    return None


def check_includes(paths):
    faults, unused = [], set(KNOWN)
    for path in paths:
        with open(os.path.join(ROOT, path), encoding="utf-8") as file:
            includes = INCLUDE.findall(file.read())
        for include in includes:
            target = found(include, path)
            fault = fault_of(path, target) if target else library_fault(include, path)
            pair = f"{path} -> {target or include}"
            if fault and pair in KNOWN:
                unused.discard(pair)
            elif fault:
                faults.append(f"{path} includes {target or include}: {fault}")
    return faults + [f"{pair}: the tree has no such fault; delete its line in KNOWN" for pair in sorted(unused)]


def check_embree(paths):
    """Embree may trace rays in one part only, and find candidates of the bake's depth in another
    part only."""
    for path in paths:
        with open(os.path.join(ROOT, path), encoding="utf-8") as file:
            if re.search(r"rtc(New|Intersect|Occluded)", file.read()) and \
                    not path.startswith(("server/rays/", "server/bake/depth/")):
                yield f"{path}: only server/rays and server/bake/depth call Embree"


def check_headers():
    """Public headers compile as C99 and as C++11, each alone."""
    folder = os.path.join(ROOT, "client/include/umbrage")
    compiler = os.environ.get("CC", "cc").split()
    for header in sorted(os.listdir(folder)):
        for mode in (["-x", "c", "-std=c99"], ["-x", "c++", "-std=c++11"]):
            words = [*compiler, *mode, "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only",
                     "-I" + os.path.join(ROOT, "client/include"), os.path.join(folder, header)]
            if subprocess.run(words, check=False).returncode:
                yield f"umbrage/{header} does not compile with {' '.join(mode)}"


def main():
    paths = sources()
    faults = [*check_includes(paths), *check_embree(paths), *check_headers()]
    for fault in faults:
        print(f"layers: {fault}")
    if not faults:
        print(f"layers: ok ({len(paths)} files, {len(KNOWN)} known exceptions)")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
