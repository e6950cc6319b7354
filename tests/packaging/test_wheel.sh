#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The wheel: what it carries, its tag, and pip without a network, here and in a bare Debian 12 root, where the commands of
# the Python guide lead to an answer within 60 s.
. "$(dirname "$0")/../harness/umbrage_test.sh"
. "$(dirname "$0")/bare_root.sh"
cd "$root" || exit 1
wheel=$(ls "$BUILD"/dist/umbrage-*.whl 2>/dev/null | head -n 1)
[ -s "$wheel" ] || {
    echo "no wheel in $BUILD/dist: make wheel"
    exit 1
}
/usr/bin/python3 tests/packaging/wheel_check.py "$wheel" >"$folder/found" 2>&1
same "the archive is whole and its tag is honest" 0 $?
cat "$folder/found"

if /usr/bin/python3 -m pip --version >/dev/null 2>&1; then
    /usr/bin/python3 -m pip install --quiet --no-index --no-deps --target "$folder/target" "$wheel" >"$folder/pip" 2>&1
    same "pip installs it" 0 $?
    cat >"$folder/ask.py" <<'SCRIPT'
import os, re, umbrage
open("wall.obj", "w").write("v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nv -3 0 0\nv 3 0 0\nv 3 0 4\nv -3 0 4\nf 1 2 3 4\nf 5 6 7 8\n")
umbrage.bake("wall.obj", "wall.umb", up="z", sun="180,45", resolution=512)
with umbrage.open("wall.umb") as asset:
    assert list(asset.query([[0, 2, 0], [0, -2, 0]], taps=9)) == [0, 1]
try:
    umbrage.connect("tcp:127.0.0.1:1").assets()
except umbrage.UnavailableError:
    pass
loaded = set(re.findall(r"/\S+\.so\S*", open("/proc/self/maps").read()))
ours = {os.path.basename(path) for path in loaded if path.startswith(os.path.dirname(umbrage.__file__))}
print("carried and loaded:", " ".join(sorted(ours)))
for name in ("libuv", "libnghttp2", "libprotobuf-c", "libxxhash", "libzstd"):
    assert not any(os.path.basename(path).startswith(name + ".so") for path in loaded), name
    assert any(one.startswith("umb" + name[3:] + ".so") for one in ours), name
SCRIPT
    (cd "$folder" && env -u LD_LIBRARY_PATH PATH=/usr/bin:/bin PYTHONPATH="$folder/target" /usr/bin/python3 ask.py) >"$folder/out" 2>&1
    same "it bakes and answers with its own libraries" 0 $?
    cat "$folder/out"
else
    left_out "pip here" "python3-pip is not installed"
fi

need_bare_root
new_root bare
cp "$wheel" "$folder/bare/"
{
    echo 'cd / && begin=$(date +%s)'
    page_block docs/guide/python.md install-wheel | grep '^apt-get'
    echo "$stop_watch"
} | in_root bare --net
same "Debian's packages of the guide are installed" 0 $?
find_all='find / -xdev \( -path /proc -o -path /run -o -path /script -o -path /tmp -o -name __pycache__ \) -prune -o -print | sort'
find_env='find . -name __pycache__ -prune -o -print | sort'
{
    echo "$find_all >/before"
    echo 'cd / && begin=$(date +%s)'
    page_block docs/guide/python.md install-wheel | grep -v '^apt-get'
    page_block docs/guide/python.md first-answer-python
    echo "$stop_watch"
    echo "$find_all >/with && env/bin/pip uninstall -y umbrage && rm wall.obj wall.umb && $find_all >/without"
    echo "python3 -m venv --system-site-packages /fresh && (cd /fresh && $find_env) >/wanted && (cd /env && $find_env) >/left"
} >"$folder/first"
check "the guide has the commands" grep -q 'pip install' "$folder/first"
in_root bare <"$folder/first"
same "pip and the guide's commands succeed without a network" 0 $?
tail -n 3 "$folder/bare.log"
check "the answer is the wall's shadow" grep -qxE '0(\.0)?' "$folder/bare.log"
in_time "$folder/bare/seconds"
same "no library of ours or of Embree is the system's" "" "$(ls "$folder/bare/usr/lib"/*/ | grep -E 'libumbrage|libembree' | tr '\n' ' ')"
check "the wheel has files in the environment" grep -q site-packages/umbrage/lib "$folder/bare/with"
same "removal leaves an environment like a new one" "" "$(comm -3 "$folder/bare/wanted" "$folder/bare/left")"
same "and nothing beside it" "" "$(comm -13 "$folder/bare/before" "$folder/bare/without" | grep -vE '^/(env(/|$)|times|seconds|before|with)')"
finish
