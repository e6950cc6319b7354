#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The libraries as other programs see them: what `make install-libraries` installs, what the shared
libraries export and need, and a program outside the tree (tests/outside) that is built with nothing
but pkg-config's words, for both kinds of libraries, as C99 and as C++11.
"""
import glob
import os
import re
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "abi"))
import abi  # noqa: E402
import umbrage_test as ut  # noqa: E402

for tool in ("pkg-config", "readelf", "nm", "gcc", "g++"):
    if shutil.which(tool) is None:
        ut.skip(f"{tool} is not installed")
if ut.is_sanitized():
    ut.skip("builds with sanitizers have no shared libraries")

OWN_NEEDS = {  # beside libc, libm, libpthread and the loader
    "umbrage-core": {"libxxhash", "libzstd"},
    "umbrage-maps": {"libumbrage-core"},
    "umbrage": {"libumbrage-core", "libuv", "libnghttp2", "libprotobuf-c", "libssl", "libcrypto"},
}
SYSTEM = {"libc", "libm", "libpthread", "ld-linux-x86-64", "ld-linux-aarch64"}
PIECE = 4096
SOURCE = os.path.join(ut.ROOT, "tests", "outside", "thin_client.c")


def words(*command, env=None, cwd=None, stdin=None):
    """Output of a command that must succeed."""
    done = subprocess.run(command, input=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=cwd,
                          env={**os.environ, "LC_ALL": "C", **(env or {})}, check=False)
    assert done.returncode == 0, f"{command}: {done.returncode}\n{done.stderr.decode(errors='replace')[-3000:]}"
    return done.stdout.decode()


test = ut.Test()
root = test.path("root")
make = ["make", "--no-print-directory", "-C", ut.ROOT, "BUILD=" + os.path.relpath(ut.BUILD, ut.ROOT),
        "install-libraries", "DESTDIR=" + root, "PREFIX=/opt/umbrage"]
config = os.path.basename(ut.BUILD)
words(*make, *([f"config={config}"] if config in ("release", "debug") else []))
lib = os.path.join(root, "opt", "umbrage", "lib")


def shared(library):
    return os.path.join(lib, f"lib{library}.so.1")


with test.check("the installed tree has headers, archives, shared libraries, links and .pc files"):
    for library in abi.LIBRARIES:
        for name in (f"lib{library}.a", f"lib{library}.so.1", f"pkgconfig/{library}.pc"):
            assert os.path.getsize(os.path.join(lib, name)) > 100, name
        assert os.readlink(os.path.join(lib, f"lib{library}.so")) == f"lib{library}.so.1"
    assert len(glob.glob(os.path.join(root, "opt/umbrage/include/umbrage/*.h"))) == len(abi.headers())

for library in abi.LIBRARIES:
    with test.check(f"lib{library}.so exports its list and nothing else"):
        rows = [row.split() for row in words("nm", "-D", "--defined-only", shared(library)).splitlines()]
        # The name of a version is itself an absolute symbol.
        names = [row[2] for row in rows if not (row[1] == "A" and row[2].startswith("UMBRAGE_"))]
        assert all(name.endswith("@@UMBRAGE_1") for name in names), names[:3]
        assert sorted(name.partition("@")[0] for name in names) == abi.exported(library)
    with test.check(f"lib{library}.so has its soname and needs no library that it does not use"):
        dynamic = words("readelf", "--wide", "--dynamic", shared(library))
        assert f"soname: [lib{library}.so.1]" in dynamic
        needed = {name.partition(".so")[0] for name in re.findall(r"NEEDED.*\[(.*)\]", dynamic)}
        assert OWN_NEEDS[library] <= needed and needed <= OWN_NEEDS[library] | SYSTEM, needed
        assert "RUNPATH" not in dynamic and "RPATH" not in dynamic
    with test.check(f"calls within lib{library}.so do not go through its table of imports"):
        relocations = words("readelf", "--wide", "--relocs", shared(library))
        imported = set(re.findall(r"(?:JUMP_SLOT?|GLOB_DAT|JUMP_SLO)\s+[0-9a-f]+ (umb_\w+)", relocations))
        assert not imported & set(abi.exported(library)), imported
        assert library == "umbrage-core" or imported, "no relocation was read"

with test.check("versions agree: headers, .pc files, programs"):
    header = ut.run("umbrage", "--version").stdout.decode().split()[1]
    for library in abi.LIBRARIES:
        assert words("pkg-config", "--modversion", os.path.join(lib, "pkgconfig", library + ".pc")).strip() == header

os.mkdir(test.path("pieces"))
asset = test.path("city.umb")
test.bake(test.scene("city", 12), asset, "--resolution", 4096, "--depth", "raster", "--verify", 0)
with open(asset, "rb") as file:
    data = file.read()
assert len(data) > 40 * PIECE, len(data)
for at in range(0, len(data), PIECE):
    with open(test.path("pieces", str(at // PIECE)), "wb") as file:
        file.write(data[at:at + PIECE])
values = ut.random_points((-200, -5, -200), (200, 60, 200), 1000, 8)
points = ut.floats(values)
text = "".join("%.9g %.9g %.9g\n" % tuple(ut.from_floats(points)[i:i + 3]) for i in range(0, len(values), 3))
expected = ut.run("umbrage", "query", asset, "--points", "-", "--taps", 9, "--quiet",
                  stdin=text.encode()).stdout.split()
assert len(set(expected)) > 5, "points that do not test anything"


def outside(tree, compiler, kind):
    """Builds the program against a tree, runs it, and returns the answers."""
    folder = os.path.join(tree, "opt", "umbrage", "lib")
    out = test.path("thin_client")
    flags = words("pkg-config", "--cflags", "--libs", *(["--static"] if kind == "static" else []), "umbrage",
                  env={"PKG_CONFIG_PATH": os.path.join(folder, "pkgconfig")}).split()
    assert root not in " ".join(flags) or tree == root, flags
    words(*compiler, "-pedantic", "-Wall", "-Werror", "-o", out, SOURCE, "-x", "none", *flags, cwd=test.folder)
    needed = words("readelf", "--wide", "--dynamic", out)
    assert ("libumbrage-core.so.1" in needed and "libumbrage.so.1" in needed) == (kind == "shared"), needed
    done = subprocess.run([out, asset, test.path("pieces")], input=points, stdout=subprocess.PIPE, check=True,
                          env={**os.environ, "LD_LIBRARY_PATH": folder})
    return [b"%.9g" % value for value in ut.from_floats(done.stdout)]


# Where both kinds are, the linker takes the shared library; so a moved tree with archives alone has
# the other kind.
archives = test.path("elsewhere", "root")
shutil.copytree(root, archives, symlinks=True)
for path in glob.glob(os.path.join(archives, "opt/umbrage/lib/*.so*")):
    os.remove(path)
for kind, tree in (("shared", root), ("static", archives)):
    for name, compiler in (("C99", ["gcc", "-x", "c", "-std=c99"]), ("C++11", ["g++", "-x", "c++", "-std=c++11"])):
        with test.check(f"a program outside the tree, {kind} libraries, {name}"):
            assert outside(tree, compiler, kind) == expected
with test.check("a piece that is missing is an error, with its name"):
    os.remove(test.path("pieces", "0"))
    done = subprocess.run([test.path("thin_client"), asset, test.path("pieces")], input=points,
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 1 and b"pieces/0: no such piece" in done.stderr, (done.returncode, done.stderr)
test.finish()
