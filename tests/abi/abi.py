#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The binary interface of the libraries: the functions that headers declare, the names that libraries
export, and the places of struct members.

    abi.py check            the export lists and tests/abi/record.txt are those of the headers
    abi.py keeps RECORD     the headers keep what an earlier record promises (umbrage/version.h)
    abi.py write BUILD      writes the lists, by the archives of a build, and the record

Needs gcc (its debugging information and -aux-info) and readelf, on a 64-bit machine.
"""
import difflib
import glob
import os
import pathlib
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import api_index  # noqa: E402

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
INCLUDE = os.path.join(ROOT, "client", "include")
EXPORTS = os.path.join(ROOT, "client", "exports")
RECORD = os.path.join(ROOT, "tests", "abi", "record.txt")
LIBRARIES = ("umbrage", "umbrage-core", "umbrage-maps")


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def headers():
    return sorted(glob.glob(os.path.join(INCLUDE, "umbrage", "*.h")))


def declared(paths=None):
    """Names of the functions that the installed headers declare."""
    return {name for path in paths or headers() for name in api_index.functions(pathlib.Path(path))}


def exported(library, folder=EXPORTS):
    return read(os.path.join(folder, library + ".txt")).split()


def run(*words):
    return subprocess.run(words, stdout=subprocess.PIPE, check=True,
                          env={**os.environ, "LC_ALL": "C"}).stdout.decode()


class Types:
    """Types in the debugging information of an object, by their offsets."""

    def __init__(self, path):
        self.entries = {}
        stack = []
        entry = None
        for line in run("readelf", "--debug-dump=info", "--wide", path).splitlines():
            begin = re.match(r"\s*<([0-9a-f]+)><([0-9a-f]+)>: Abbrev Number: \d+ \((DW_TAG_\w+)\)", line)
            value = re.match(r"\s*<[0-9a-f]+>\s+(DW_AT_\w+)\s*: (.*)", line)
            if begin:
                depth = int(begin.group(1), 16)
                entry = {"tag": begin.group(3)[7:], "children": []}
                self.entries[int(begin.group(2), 16)] = entry
                del stack[depth:]
                if stack:
                    stack[-1]["children"].append(entry)
                stack.append(entry)
            elif value and entry is not None:
                text = value.group(2).strip()
                entry[value.group(1)[6:]] = re.sub(r"^(\([^)]*\):? ?)+", "", text)

    def number(self, entry, name, default=0):
        return int(entry.get(name, str(default)).split()[0], 0)

    def target(self, entry):
        return self.entries[int(re.search(r"<0x([0-9a-f]+)>", entry["type"]).group(1), 16)]

    def text(self, entry):
        """The type of an entry, as C would name it."""
        if "type" not in entry:
            return "void"
        kind = self.target(entry)
        tag = kind["tag"]
        if tag == "pointer_type":
            return self.text(kind) + " *"
        if tag == "const_type":
            return "const " + self.text(kind)
        if tag == "array_type":
            sizes = [self.number(c, "upper_bound", -1) + 1 for c in kind["children"] if c["tag"] == "subrange_type"]
            return self.text(kind) + "".join(f"[{size}]" for size in sizes)
        if tag == "subroutine_type":
            parameters = [self.text(c) for c in kind["children"] if c["tag"] == "formal_parameter"]
            return f"{self.text(kind)} ({', '.join(parameters)})"
        if tag == "typedef" and kind["name"].startswith("umb_"):
            return self.text(kind)
        if tag in ("structure_type", "union_type") and "name" not in kind:
            return "{" + "; ".join(" ".join(row) for row in self.members(kind)) + "}"
        prefix = {"structure_type": "struct ", "enumeration_type": "enum "}.get(tag, "")
        return prefix + kind["name"]

    def members(self, entry):
        """Rows (name, offset, type) of a struct."""
        return [(c["name"], str(self.number(c, "data_member_location")), self.text(c))
                for c in entry["children"] if c["tag"] == "member"]


def interface():
    """The interface as blocks of rows: libraries, structs, enums, function types and functions."""
    blocks, wanted = {f"library {library}": exported(library) for library in LIBRARIES}, declared()
    blocks["soname"] = re.findall(r"^SONAME := (\d+)$", read(os.path.join(ROOT, "Makefile")), re.M)
    with tempfile.TemporaryDirectory() as folder:
        source, made, prototypes = (os.path.join(folder, name) for name in ("all.c", "all.o", "all.X"))
        with open(source, "w", encoding="utf-8") as file:
            file.writelines(f'#include "umbrage/{os.path.basename(path)}"\n' for path in headers())
        run("gcc", "-std=c99", "-g", "-gdwarf-4", "-fno-eliminate-unused-debug-types", "-aux-info", prototypes,
            "-I" + INCLUDE, "-c", source, "-o", made)
        types = Types(made)
        for entry in types.entries.values():
            name = entry.get("name", "")
            if not name.startswith("umb_") or "declaration" in entry:
                continue
            if entry["tag"] == "structure_type":
                rows = [" ".join(row) for row in types.members(entry)]
                blocks[f"struct {name}"] = [f"size {types.number(entry, 'byte_size')}"] + rows
            elif entry["tag"] == "enumeration_type":
                blocks[f"enum {name}"] = [f"size {types.number(entry, 'byte_size')}"] + [
                    f"{c['name']} {c['const_value']}" for c in entry["children"]]
            elif entry["tag"] == "typedef":
                blocks[f"typedef {name}"] = [types.text(entry)]
        for line in read(prototypes).splitlines():
            found = re.match(r"/\* .*? \*/ extern (.*?)(umb_\w+) \((.*)\);", line)
            if found and found.group(2) in wanted:
                blocks[f"function {found.group(2)}"] = [f"{found.group(1).strip()} ({found.group(3)})"]
    return blocks


def record_text(blocks):
    lines = ["# The binary interface of the libraries, for 64-bit systems: written by `make abi-record`, held by `make lint`."]
    for name in sorted(blocks):
        lines += ["", name] + ["    " + row for row in blocks[name]]
    return "\n".join(lines) + "\n"


def record_read(text):
    blocks, rows = {}, None
    for line in text.splitlines():
        if line.startswith("    "):
            rows.append(line[4:])
        elif line and not line.startswith("#"):
            rows = blocks.setdefault(line, [])
    return blocks


def struct_breaks(name, old, new):
    """What a later struct breaks: it may only take words of `reserved` for new members."""
    if old[0] != new[0]:
        yield f"{name}: {old[0]} is now {new[0]}"
    before = {row.split()[0]: row for row in old[1:]}
    after = {row.split()[0]: row for row in new[1:]}
    room = int(before["reserved"].split()[1]) if "reserved" in before else None
    for member, row in before.items():
        if member != "reserved" and after.get(member) != row:
            yield f"{name}: '{row}' is now '{after.get(member, 'gone')}'"
    for member, row in after.items():
        if member not in before and (room is None or int(row.split()[1]) < room):
            yield f"{name}: '{row}' is new and not taken from reserved"


def breaks(old, new):
    """Sentences, one for each promise of the old record that the new one does not keep."""
    if old["soname"] != new["soname"]:
        return
    for name, rows in old.items():
        if name not in new:
            yield f"{name} is gone"
        elif name.startswith("struct "):
            yield from struct_breaks(name, rows, new[name])
        elif name.startswith(("enum ", "library ")):
            yield from (f"{name}: '{row}' is gone" for row in rows if row not in new[name])
        elif rows != new[name]:
            yield f"{name}: '{rows[0]}' is now '{new[name][0]}'"


def shape_faults(blocks):
    """`reserved` is whole words at a struct's end."""
    for name, rows in blocks.items():
        if not name.startswith("struct "):
            continue
        for row in rows[1:-1]:
            if row.startswith("reserved "):
                yield f"{name}: reserved is not the last member"
        last = rows[-1].split()
        if last[0] == "reserved":
            words = re.fullmatch(r"uint64_t\[(\d+)\]", last[2])
            if not words or int(last[1]) % 8 or int(last[1]) + 8 * int(words.group(1)) != int(rows[0].split()[1]):
                yield f"{name}: reserved is not uint64_t words up to the struct's end"


def list_faults(folder=EXPORTS, folder_headers=None):
    wanted, found = declared(folder_headers), []
    for library in LIBRARIES:
        names = exported(library, folder)
        if names != sorted(set(names)):
            yield f"{library}.txt is not sorted, or names a function twice"
        found += names
    for name in sorted(wanted ^ set(found)):
        yield f"{name} is {'declared by a header and' if name in wanted else 'in a list and declared by'} " + (
            "in no list" if name in wanted else "no header")
    for name in sorted({name for name in found if found.count(name) > 1}):
        yield f"{name} is in two lists"


def write(build):
    wanted = declared()
    for library in LIBRARIES:
        rows = run("nm", "--defined-only", os.path.join(build, f"lib{library}.a")).splitlines()
        names = sorted(wanted & {row.split()[-1] for row in rows if " T " in row})
        with open(os.path.join(EXPORTS, library + ".txt"), "w", encoding="utf-8") as file:
            file.writelines(name + "\n" for name in names)
    with open(RECORD, "w", encoding="utf-8") as file:
        file.write(record_text(interface()))


def check():
    blocks = interface()
    for path in headers():
        if not re.search(r"^ \* Stability: (stable|experimental)\b", read(path), re.M):
            yield f"{os.path.basename(path)}: no line 'Stability: stable' or 'Stability: experimental'"
    yield from list_faults()
    yield from shape_faults(blocks)
    yield from difflib.unified_diff(read(RECORD).splitlines(), record_text(blocks).splitlines(),
                                    "tests/abi/record.txt", "the headers (make abi-record)", lineterm="", n=1)


def main(words):
    if words[:1] == ["write"] and len(words) == 2:
        write(words[1])
        return 0
    if words == ["check"]:
        faults = list(check())
    elif words[:1] == ["keeps"] and len(words) == 2:
        faults = list(breaks(record_read(read(words[1])), interface()))
    else:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    for fault in faults:
        print("abi: " + fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
