#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
wheel.py VERSION MODULE NATIVE OUT: writes OUT/umbrage-VERSION-py3-none-PLATFORM.whl.

MODULE  folder of the Python module
NATIVE  folder with lib/ (our libraries) and bin/ (umbrage-bake), linked with an RPATH of $ORIGIN/../lib

The wheel carries every library that these need, except glibc and the runtime libraries of gcc. A carried libX.so.N is
renamed umbX.so.N in the file and in all that need it, so that a process never takes it for the system's libX.so.N or
the other way round. The new name has the length of the old one: the bytes of names are overwritten and nothing moves.

PLATFORM is manylinux_2_N if no symbol is younger than glibc 2.N (PEP 600), else linux. Times are SOURCE_DATE_EPOCH, or
the last commit's. The same files give the same bytes.
"""
import base64
import hashlib
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zipfile

import elf_needs

# Libraries that PEP 600's platforms have.
PLATFORM = {"libc.so.6", "libm.so.6", "libdl.so.2", "libpthread.so.0", "librt.so.1", "libgcc_s.so.1", "libstdc++.so.6",
            "ld-linux-x86-64.so.2", "ld-linux-aarch64.so.1"}
# Newest symbols of gcc's runtime libraries on systems with glibc 2.34 (gcc 11), and with 2.35 and later (gcc 12).
OLDEST, NEXT = 34, 35
RUNTIME = {OLDEST: {"GLIBCXX": (3, 4, 29), "CXXABI": (1, 3, 13), "GCC": (11,)},
           NEXT: {"GLIBCXX": (3, 4, 30), "CXXABI": (1, 3, 13), "GCC": (12, 0, 0)}}
MACHINES = {62: "x86_64", 183: "aarch64"}
DT_STRTAB, DT_STRSZ, PT_LOAD, PT_DYNAMIC = 5, 10, 1, 2

METADATA = """Metadata-Version: 2.1
Name: umbrage
Version: {version}
Summary: Shadow queries: how much of a light reaches a point
License: Apache-2.0; the folder licenses has those of the carried libraries
Classifier: License :: OSI Approved :: Apache Software License
Classifier: Operating System :: POSIX :: Linux
Classifier: Typing :: Typed
Requires-Python: >=3.9
Requires-Dist: cffi>=1.15
Requires-Dist: numpy>=1.20
Description-Content-Type: text/markdown

# umbrage

Bakes the shadows of a static scene once into a small file, and answers how much of a light reaches a point, for
millions of points a second, with numpy arrays. `help(umbrage)` describes it. The wheel carries the C libraries and
`umbrage-bake`; nothing is compiled.
"""


def fail(sentence):
    sys.exit(f"wheel: {sentence}")


def carried_libraries(files):
    """{soname: path} of what the files need beyond the platform and each other."""
    ours, found = {os.path.basename(path) for path in files}, {}
    for path in files:
        places, wanted = elf_needs.resolved(path), elf_needs.needed(path)
        while wanted:
            name = wanted.pop()
            if name in PLATFORM | ours | set(found):
                continue
            if name not in places:
                fail(f"{path}: {name} is not installed")
            found[name] = places[name]
            wanted += elf_needs.needed(places[name])
    return found


def dynamic_names(data):
    """Offset and length of the table of names that the loader reads."""
    if data[:6] != b"\x7fELF\x02\x01":
        fail("not a 64-bit little-endian ELF file")
    offset, size, count = struct.unpack_from("<Q", data, 32)[0], *struct.unpack_from("<HH", data, 54)
    headers = [struct.unpack_from("<IIQQQQ", data, offset + i * size) for i in range(count)]
    dynamic = next(one for one in headers if one[0] == PT_DYNAMIC)
    tags = dict(struct.unpack_from("<QQ", data, dynamic[2] + at) for at in range(0, dynamic[5], 16))
    for kind, _, begin, address, _, length in headers:
        if kind == PT_LOAD and address <= tags[DT_STRTAB] < address + length:
            return tags[DT_STRTAB] - address + begin, tags[DT_STRSZ]
    return fail("a table of names outside of the file")


def own_name(soname):
    """The name under which the wheel carries a library."""
    if not soname.startswith("lib"):
        fail(f"{soname}: does not begin with lib")
    return "umb" + soname[3:]


def rename(path, sonames):
    """Renames carried libraries in a file's own name and needs."""
    with open(path, "r+b") as file:
        data = bytearray(file.read())
        begin, length = dynamic_names(data)
        names = bytes(data[begin:begin + length])
        for soname in sonames:
            names = names.replace(b"\0" + soname.encode() + b"\0", b"\0" + own_name(soname).encode() + b"\0")
        data[begin:begin + length] = names
        file.seek(0)
        file.write(data)


def platform_tag(paths):
    """The platform's tag: the oldest glibc that has every symbol, or linux where no platform has them."""
    versions = {}
    for path in paths:
        for word in elf_needs.symbol_versions(path):
            kind, _, number = word.partition("_")
            if kind in ("GLIBC", "GLIBCXX", "CXXABI", "GCC"):
                key = tuple(int(part) for part in number.split(".")) if number[:1].isdigit() else (1 << 30,)
                versions[kind] = max(versions.get(kind, ()), key)
        with open(path, "rb") as file:
            machine = MACHINES.get(struct.unpack_from("<H", file.read(20), 18)[0]) or fail(f"{path}: unknown machine")
    major, minor = (*versions.pop("GLIBC", (2, 0)), 0)[:2]
    for glibc in range(max(minor, OLDEST), max(minor, NEXT) + 1) if major == 2 else ():
        if all(version <= RUNTIME[min(glibc, NEXT)][kind] for kind, version in versions.items()):
            return f"manylinux_2_{glibc}_{machine}"
    return f"linux_{machine}"


def digest(data):
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


def write_zip(path, files, when):
    """A zip archive of {name: (bytes, mode)}, with its RECORD."""
    record = next(name for name in files if name.endswith("/METADATA")).replace("METADATA", "RECORD")
    lines = [f"{name},sha256={digest(data)},{len(data)}" for name, (data, _) in sorted(files.items())]
    files[record] = ("\n".join(lines + [f"{record},,", ""]).encode(), 0o644)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files, key=lambda name: (".dist-info/" in name, name)):
            data, mode = files[name]
            info = zipfile.ZipInfo(name, when)
            info.external_attr, info.create_system, info.compress_type = (0o100000 | mode) << 16, 3, zipfile.ZIP_DEFLATED
            archive.writestr(info, data)


def read(path):
    with open(path, "rb") as file:
        return file.read()


def build_time():
    """Year, month ... of SOURCE_DATE_EPOCH or the last commit; zip knows even seconds from 1980 on."""
    seconds = os.environ.get("SOURCE_DATE_EPOCH") or elf_needs.output_of("git", "log", "-1", "--format=%ct")
    return max(time.gmtime(int(seconds))[:6], (1980, 1, 1, 0, 0, 0))


def licences(libraries):
    """{file: bytes}: the copyright files of the packages of carried libraries."""
    packages = {elf_needs.package_of(path) for path in libraries.values()}
    return {name: read(f"/usr/share/doc/{name}/copyright") for name in packages}


def main(version, module, native, out):
    programs = [os.path.join(native, kind, name) for kind in ("lib", "bin") for name in
                sorted(os.listdir(os.path.join(native, kind)))]
    libraries = carried_libraries(programs)
    info = f"umbrage-{version}.dist-info"
    files = {f"umbrage/{name}": (read(os.path.join(module, name)), 0o644) for name in os.listdir(module)
             if name.endswith((".py", ".typed"))}
    with tempfile.TemporaryDirectory() as folder:
        staged = {}
        for path in programs:
            staged["umbrage/" + os.path.relpath(path, native)] = shutil.copy(path, folder)
        for soname, path in libraries.items():
            staged["umbrage/lib/" + own_name(soname)] = shutil.copyfile(path, os.path.join(folder, own_name(soname)))
        for path in staged.values():
            os.chmod(path, 0o755)
            rename(path, libraries)
        tag = f"py3-none-{platform_tag(staged.values())}"
        files.update((name, (read(path), 0o755 if "/bin/" in name else 0o644)) for name, path in staged.items())
    files.update((f"{info}/licenses/{name}/copyright", (data, 0o644)) for name, data in licences(libraries).items())
    files[f"{info}/licenses/LICENSE"] = (read("LICENSE"), 0o644)
    files[f"{info}/METADATA"] = (METADATA.format(version=version).encode(), 0o644)
    files[f"{info}/WHEEL"] = (f"Wheel-Version: 1.0\nGenerator: umbrage\nRoot-Is-Purelib: false\nTag: {tag}\n".encode(),
                              0o644)
    os.makedirs(out, exist_ok=True)
    name = os.path.join(out, f"umbrage-{version}-{tag}.whl")
    write_zip(name, files, build_time())
    print(f"{name} ({os.path.getsize(name) >> 20} MiB, {len(libraries)} carried libraries)")


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except subprocess.SubprocessError as problem:
        fail(str(problem))
