#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
declarations.py OUT: writes OUT/_declarations.py, the C API as cffi's tables, from the public headers. The tables need
no C compiler and no parser when the module is loaded. Values of enums and of plain number macros come with them.
"""
import os
import re
import subprocess
import sys
import tempfile

import cffi

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
HEADERS = ("version alloc geom status asset file query curve volume workers sample picture partial region log client "
           "volume_queries jobs aliasing cascades maps derive").split()
SYSTEM = "stdint stddef stdbool".split()  # cffi knows their types
NUMBER = re.compile(r"^#define (UMB_[A-Z0-9_]+) \(?(-?(?:0x[0-9a-fA-F]+|[0-9]+))[uUlL]*\)?$", re.MULTILINE)
# What cffi cannot express and Python does not call.
DROPPED = ("umb_fail", "umb_fail_errno")


def preprocessed(folder, *options):
    source = os.path.join(folder, "all.c")
    for name in SYSTEM:
        with open(os.path.join(folder, name + ".h"), "w", encoding="utf-8"):
            pass
    with open(source, "w", encoding="utf-8") as file:
        file.writelines(f'#include "umbrage/{name}.h"\n' for name in HEADERS)
    words = [*(os.environ.get("CC") or "cc").split(), "-E", "-P", "-nostdinc", "-D__attribute__(x)=", "-I", folder,
             "-I", os.path.join(ROOT, "client", "include"), *options, source]
    return subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout


def main():
    with tempfile.TemporaryDirectory() as folder:
        text = preprocessed(folder)
        numbers = dict(NUMBER.findall(preprocessed(folder, "-dM")))
    for name in DROPPED:
        text = re.sub(rf"[^;]*\b{name}\([^;]*;", "", text)
    text += "\n".join(f"#define {name} {value}" for name, value in sorted(numbers.items())
                      if not re.search(rf"\b{name} = ", text))
    ffi = cffi.FFI()
    ffi.cdef(text)
    ffi.set_source("umbrage._declarations", None)
    out = os.path.join(sys.argv[1], "_declarations.py")
    ffi.emit_python_code(out)
    with open(out, "r+", encoding="utf-8") as file:
        tables = file.read()
        file.seek(0)
        file.write("# mypy: ignore-errors\n" + tables)


if __name__ == "__main__":
    main()
