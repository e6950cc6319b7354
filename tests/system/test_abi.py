#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The binary interface must be that of its record. The comparison with an earlier record
(tests/abi/abi.py) must find changes that break programs: each kind of break is planted.
"""
import copy
import os
import shutil
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "abi"))
import abi  # noqa: E402
import umbrage_test as ut  # noqa: E402

for tool in ("gcc", "readelf"):
    if shutil.which(tool) is None:
        ut.skip(f"{tool} is not installed")
if sys.maxsize < 2 ** 32:
    ut.skip("the record is of 64-bit systems")

test = ut.Test()
with test.check("lists and record are those of the headers"):
    faults = list(abi.check())
    assert not faults, "\n".join(faults)
record = abi.record_read(abi.read(abi.RECORD))
with test.check("the record has every struct, enum and function, and reads back"):
    assert sum(name.startswith("function ") for name in record) == len(abi.declared()) > 100
    assert record["struct umb_box"] == ["size 48", "min 0 double[3]", "max 24 double[3]"]
    assert "UMB_E_INTERNAL -80" in record["enum umb_status"]
    assert abi.record_read(abi.record_text(record)) == record
    assert not list(abi.breaks(record, record))

SMALL = {
    "soname": ["1"],
    "library umbrage": ["umb_a", "umb_b"],
    "library umbrage-core": ["umb_c"],
    "struct umb_open": ["size 48", "one 0 double", "two 8 int", "reserved 16 uint64_t[4]"],
    "struct umb_closed": ["size 16", "one 0 double", "two 8 int"],
    "enum umb_e": ["size 4", "UMB_X 0", "UMB_Y 1"],
    "typedef umb_fn": ["void (void *) *"],
    "function umb_a": ["void (int)"],
    "function umb_b": ["void (int)"],
    "function umb_c": ["int (void)"],
}


def after(edit):
    """Breaks that an edit of the small record makes."""
    new = copy.deepcopy(SMALL)
    edit(new)
    return list(abi.breaks(SMALL, new))


def replace(name, old, *rows):
    """An edit that puts rows in the place of one."""
    def edit(new):
        at = new[name].index(old)
        new[name][at:at + 1] = rows
    return edit


KEEPS = {
    "a member takes the first words of reserved": replace(
        "struct umb_open", "reserved 16 uint64_t[4]", "three 16 double", "reserved 24 uint64_t[3]"),
    "members take all of reserved": replace("struct umb_open", "reserved 16 uint64_t[4]", "three 16 double[4]"),
    "an enum gets a value": replace("enum umb_e", "UMB_Y 1", "UMB_Y 1", "UMB_Z 2"),
    "a library gets a function": replace("library umbrage", "umb_b", "umb_b", "umb_d"),
    "a struct is new": lambda new: new.update({"struct umb_new": ["size 8", "one 0 double"]}),
    "a new soname may change anything": lambda new: new.update({"soname": ["2"], "library umbrage": []}),
}
BREAKS = {
    "a member moves": replace("struct umb_open", "two 8 int", "two 12 int"),
    "a member changes its type": replace("struct umb_open", "two 8 int", "two 8 float"),
    "a member goes": replace("struct umb_open", "two 8 int"),
    "a struct grows at its end": replace("struct umb_open", "size 48", "size 56"),
    "a member lies before reserved": replace("struct umb_open", "two 8 int", "two 8 int", "three 12 int"),
    "a closed struct gets a member": replace("struct umb_closed", "two 8 int", "two 8 int", "three 12 int"),
    "a struct goes": lambda new: new.pop("struct umb_closed"),
    "a value gets another number": replace("enum umb_e", "UMB_Y 1", "UMB_Y 2"),
    "a value goes": replace("enum umb_e", "UMB_Y 1"),
    "a callback changes": replace("typedef umb_fn", "void (void *) *", "int (void *) *"),
    "a parameter changes": replace("function umb_a", "void (int)", "void (long)"),
    "a function goes": lambda new: (new.pop("function umb_b"), new["library umbrage"].remove("umb_b")),
    "a function moves to another library": lambda new: (new["library umbrage"].remove("umb_a"),
                                                        new["library umbrage-core"].append("umb_a")),
}
for sentence, edit in KEEPS.items():
    with test.check(f"kept: {sentence}"):
        assert not after(edit), after(edit)
for sentence, edit in BREAKS.items():
    with test.check(f"broken: {sentence}"):
        assert after(edit)

with test.check("reserved that is not whole words at a struct's end is found"):
    assert not list(abi.shape_faults(SMALL))
    for row in ("reserved 16 uint64_t[3]", "reserved 16 uint32_t[8]", "reserved 16 char[32]"):
        assert list(abi.shape_faults({"struct umb_open": SMALL["struct umb_open"][:3] + [row]})), row
    rows = SMALL["struct umb_open"]
    assert list(abi.shape_faults({"struct umb_open": [rows[0], rows[1], rows[3], rows[2]]}))

lists = test.path("exports")
with test.check("lists that are not what headers declare are found"):
    shutil.copytree(abi.EXPORTS, lists)
    assert not list(abi.list_faults(lists))
    names = abi.exported("umbrage-core", lists)
    for wrong in (names[1:], names + ["umb_zzz"], names[::-1], names + abi.exported("umbrage", lists)[-1:]):
        with open(os.path.join(lists, "umbrage-core.txt"), "w", encoding="utf-8") as file:
            file.writelines(name + "\n" for name in wrong)
        assert list(abi.list_faults(lists)), wrong[:2]
with test.check("a function that a header adds is missed in the lists"):
    header = test.path("more.h")
    with open(header, "w", encoding="utf-8") as file:
        file.write("/* UMB_API void umb_not_me(void); */\n#define UMB_API\n"
                   "UMB_API UMB_CHECKED enum umb_status\numb_more(void (*told)(void *), void *user);\n")
    assert abi.declared([header]) == {"umb_more"}
    assert any("umb_more" in fault for fault in abi.list_faults(abi.EXPORTS, abi.headers() + [header]))
test.finish()
