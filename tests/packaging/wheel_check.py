#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
wheel_check.py WHEEL: RECORD has every file with its digest; libraries need nothing but what the wheel carries and what
the platform of its tag has, by `nm` alone; carried libraries have licences.
"""
import base64
import csv
import hashlib
import io
import os
import re
import subprocess
import sys
import tempfile
import zipfile

# Libraries that PEP 600 lets a wheel take from the system, of those that C and C++ need.
SYSTEM = re.compile(r"(libc|libm|libdl|libpthread|librt|libgcc_s|libstdc\+\+|ld-linux-(x86-64|aarch64))\.so\.\d+$")


def dynamic(path, *options):
    return subprocess.run(["nm", "-D", *options, path], stdout=subprocess.PIPE, check=True, text=True).stdout


def main(wheel):
    problems = []
    name, version, python, abi, platform = os.path.basename(wheel).removesuffix(".whl").split("-")
    with zipfile.ZipFile(wheel) as archive:
        files = {info.filename: archive.read(info) for info in archive.infolist()}
        modes = {info.filename: info.external_attr >> 16 & 0o777 for info in archive.infolist()}
    info = f"{name}-{version}.dist-info/"
    record = {row[0]: row[1:] for row in csv.reader(io.StringIO(files[info + "RECORD"].decode())) if row}
    for path in sorted(set(files) ^ set(record)):
        problems.append(f"{path}: in RECORD or in the archive, but not in both")
    for path, (told, size) in record.items():
        found = base64.urlsafe_b64encode(hashlib.sha256(files[path]).digest()).rstrip(b"=").decode()
        if path != info + "RECORD" and (told != "sha256=" + found or int(size) != len(files[path])):
            problems.append(f"{path}: RECORD has another digest or length")
    if f"Tag: {python}-{abi}-{platform}" not in files[info + "WHEEL"].decode():
        problems.append("WHEEL has another tag than the file's name")
    glibc = re.match(r"manylinux_2_(\d+)_", platform)
    most = int(glibc.group(1)) if glibc else 10**9
    programs = [path for path, data in files.items() if data[:4] == b"\x7fELF"]
    carried = {os.path.basename(path) for path in programs}
    newest = 0
    with tempfile.TemporaryDirectory() as folder:
        for path in programs:
            place = os.path.join(folder, os.path.basename(path))
            with open(place, "wb") as out:
                out.write(files[path])
            wanted = [int(minor) for minor in re.findall(r"@GLIBC_2\.(\d+)", dynamic(place, "--undefined-only", "--with-symbol-versions"))]
            newest = max([newest, *wanted])
            sections = subprocess.run(["objdump", "-p", place], stdout=subprocess.PIPE, check=True, text=True).stdout
            for need in re.findall(r"NEEDED\s+(\S+)", sections):
                if need not in carried and not SYSTEM.match(need):
                    problems.append(f"{path}: needs {need}, which the wheel does not carry")
            if b"/build" in files[path] and b"umbrage" in path.encode() and re.search(rb"/[a-z/]+/(client|server)/[a-z_/]+\.c\0", files[path]):
                problems.append(f"{path}: names a path of the machine that built it")
    if newest > most:
        problems.append(f"a symbol of glibc 2.{newest} under the tag {platform}")
    for path in ("umbrage/bin/umbrage-bake", "umbrage/lib/libumbrage.so.1", "umbrage/py.typed", "umbrage/_declarations.py"):
        if path not in files:
            problems.append(f"{path} is missing")
    if modes.get("umbrage/bin/umbrage-bake") != 0o755:
        problems.append("umbrage-bake cannot be executed")
    licences = [path for path in files if path.startswith(info + "licenses/")]
    if len(licences) < 8:
        problems.append(f"only {len(licences)} licence files")
    print("\n".join(problems) or f"{platform}: {len(programs)} programs and libraries, newest symbol of glibc 2.{newest}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
