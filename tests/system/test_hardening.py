#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Reads the installed programs and libraries of a release build for each layer of hardening
(docs/explained/testing.md): a flag that goes missing from the Makefile, or from one object, fails
here. Needs readelf.
"""
import glob
import os
import re
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

if shutil.which("readelf") is None:
    ut.skip("readelf is not installed (binutils has it)")
PROGRAMS = ("umbrage", "umbraged", "umbrage-bake", "umbrage-study")
LIBRARIES = ("libumbrage-core.so.1", "libumbrage-maps.so.1", "libumbrage.so.1")
STALE = "; if the build folder is older than the flags: make clean"


def readelf(*words):
    done = subprocess.run(["readelf", "--wide", *words], stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL, check=True, env={**os.environ, "LC_ALL": "C"})
    return done.stdout.decode(errors="replace")


def compiler_words(path):
    """The options of the compiler, from the debugging information of C objects."""
    return re.findall(r"DW_AT_producer.*: (.*)", readelf("--debug-dump=info", "--dwarf-depth=1", path))


def objects():
    """Objects of the four programs, without those of tests."""
    build = os.path.relpath(ut.BUILD)
    found = [path for part in ("client", "proto", "server", "gen")
             for path in glob.glob(os.path.join(build, part, "**", "*.o"), recursive=True)]
    assert len(found) > 100, (build, len(found))
    return sorted(found)


def has_cet(path):
    return re.search(r"x86 feature: .*IBT.*SHSTK", readelf("-n", path)) is not None


def start_file(name):
    """A file that the compiler links into every program."""
    compiler = os.environ.get("CC", "gcc").split()[-1]
    done = subprocess.run([compiler, f"-print-file-name={name}"], stdout=subprocess.PIPE, check=True)
    return done.stdout.decode().strip()


main_object = os.path.join(ut.BUILD, "client", "cli", "cli_main.o")
produced = " ".join(compiler_words(main_object))
if ut.is_sanitized() or re.search(r"-fsanitize=|-O0", produced) or (
        "clang" not in produced and "-O2" not in produced):
    ut.skip("not a release build")

test = ut.Test()
headers = {name: readelf("--file-header", "--program-headers", "--dynamic", ut.program(name))
           for name in PROGRAMS + LIBRARIES}
symbols = {name: readelf("--dyn-syms", ut.program(name)) for name in PROGRAMS + LIBRARIES}
for name in PROGRAMS + LIBRARIES:
    with test.check(f"{name} is position independent"):
        assert re.search(r"Type: +DYN", headers[name])
        assert name in LIBRARIES or re.search(r"Flags:.* PIE", headers[name])
        assert "TEXTREL" not in headers[name]
    with test.check(f"{name} has no stack that can be executed, and no segment both writable and executable"):
        stack, = re.findall(r"GNU_STACK.* (R[W ][E ]) ", headers[name])
        assert stack == "RW ", stack
        loads = re.findall(r"LOAD .* ([R ][W ][E ]) ", headers[name])
        assert len(loads) >= 2 and "RWE" not in loads, loads
    with test.check(f"{name} resolves all symbols at its start and then makes their table read-only"):
        assert "GNU_RELRO" in headers[name]
        assert re.search(r"\(FLAGS\).*BIND_NOW", headers[name]), "no BIND_NOW" + STALE
        assert re.search(r"\(FLAGS_1\).*NOW", headers[name])
    with test.check(f"{name} checks stacks and the sizes of buffers"):
        assert "__stack_chk_fail" in symbols[name], "no stack protector" + STALE
        for function in ("memcpy", "snprintf") if name in PROGRAMS else ("v?snprintf",):
            assert re.search(f"__{function}_chk", symbols[name]), f"no checked {function}" + STALE

# A program's symbols show that some object has a layer; its objects show that all have it.
with test.check("every object that prints does so by the checked functions"):
    plain = {path for path in objects() if re.search(
        r" UND v?f?printf$", readelf("--symbols", path), re.MULTILINE)}
    assert not plain, f"{sorted(plain)[:5]}{STALE}"

if "clang" not in produced:
    WANTED = ["-fstack-protector-strong", "-fstack-clash-protection"]
    if os.uname().machine == "x86_64":
        WANTED.append("-fcf-protection=full")
    # client/module.mk says why.
    EXEMPT = {("client/core/query/slice_count.o", "-fstack-protector-strong")}
    with test.check("every object was compiled with every flag"):
        for path in objects():
            name = os.path.relpath(path, ut.BUILD)
            words = " ".join(w for w in compiler_words(path) if w.startswith("GNU C"))
            assert words, f"{name} does not say how it was compiled"
            missing = [flag for flag in WANTED if flag not in words and (name, flag) not in EXEMPT]
            assert not missing, f"{name}: {missing}{STALE}"

# If a library or a start file of the system lacks the note, the linker leaves the note out of the
# program.
if os.uname().machine == "x86_64":
    with test.check("every object has landing pads and shadow stacks (IBT, SHSTK)"):
        without = [path for path in objects() if not has_cet(path)]
        assert not without, f"{without[:5]}{STALE}"
    system = [start_file(name) for name in ("Scrt1.o", "crti.o", "crtbeginS.o", "crtendS.o", "crtn.o")]
    lacking = [os.path.basename(path) for path in system if not has_cet(path)]
    if lacking:
        ut.left_out("the programs' own notes of IBT and SHSTK", f"the system's {lacking[0]} has none")
    else:
        with test.check("every program and library says that it has them"):
            for name in PROGRAMS + LIBRARIES:
                assert has_cet(ut.program(name)), name
test.finish()
