#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The dial: every asset's curve is compared with rays; tested are the choice of settings by error
# and by budget, and the choice of a resolution by --max-error.
. "$(dirname "$0")/../harness/umbrage_test.sh"
cd "$folder" || exit 1

bake() { # NAME SCENE OPTION...
    name=$1 scene=$2
    shift 2
    check "$name is baked" "$BUILD/umbrage-bake" "$scene" -o "$name.umb" --quiet --verify 0 "$@"
}

# Halving the required error must never widen the bound, and never lower the cost.
halve() { # NAME FIRST UNIT
    /usr/bin/python3 - "$BUILD/umbrage" "$1.umb" "$2" "$3" <<'PYTHON'
import json, subprocess, sys
umbrage, asset, wanted, unit = sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4]
last, found = None, 0
while True:
    run = subprocess.run([umbrage, "query", asset, "--points", "points", "--json", "--quiet",
                          "--max-error", f"{wanted}{unit}"], capture_output=True, text=True)
    if run.returncode != 0:
        assert run.returncode == 2 and run.stderr.count("\n") == 1, run.stderr
        break
    now = json.loads(run.stdout)
    error = now["bound_m"] if unit == "m" else now["visibility_error"]
    assert error <= wanted, (error, wanted)
    if last:
        assert error <= last[0] and now["lines_per_point"] >= last[1], (now, last)
    last, found, wanted = (error, now["lines_per_point"]), found + 1, wanted / 2
assert found >= 2, found
PYTHON
}

"$BUILD/scenegen" city --size 8 -o city.glb 2>/dev/null
"$BUILD/scenegen" terrain --size 64 -o terrain.ply 2>/dev/null
"$BUILD/scenegen" arch --size 3 -o arch.glb 2>/dev/null
"$BUILD/umbrage" points city.glb -o points --format text --normals --count 3000 --quiet
bake city city.glb --resolution 2048
bake open city.glb --resolution 1024 --closed off
bake terrain terrain.ply --resolution 1024 --sun 200,25
bake arch arch.glb --resolution 1024
bake lamps city.glb --resolution 256 --point 10,40,30 --spot 0,90,0,0.3,-1,0.2,40
for pair in city:city.glb open:city.glb terrain:terrain.ply arch:arch.glb lamps:city.glb; do
    try 0 umbrage verify "${pair%:*}.umb" --scene "${pair#*:}" --bounds --points 8000 --json
    cp out bounds
    same "${pair%:*}: every bound is true" True "$(json bounds "['true']")"
    check "${pair%:*}: wide answers differ from rays, so that this says something" \
        json bounds "['bounds'][8]['differ'] > 50 or 1 / 0"
    check "${pair%:*}: halving metres" halve "${pair%:*}" 1000 m
    check "${pair%:*}: halving visibility" halve "${pair%:*}" 1 vis
done

try 0 umbrage query city.umb --points points --budget 100000 --json --quiet
check "a budget states what it expects to pay" json out "['expected_ns'] > 0 or 1 / 0"
cp out dialled
check "and what was paid" json out "['ns_per_point'] > 0 or 1 / 0"
taps=$(json dialled "['taps']") level=$(json dialled "['level']")
try 0 umbrage query city.umb --points points --taps "$taps" --level "$level" --json --quiet
same "and answers as its setting does" "$(json dialled "['answers']")" "$(json out "['answers']")"
"$BUILD/umbrage" query city.umb --points - --budget 100000 --json --quiet <points >piped
check "points that come but once have a budget too" json piped "['expected_ns'] > 0 or 1 / 0"
try 2 umbrage query city.umb --points points --budget 0.001
one_sentence budget

try 0 umbrage-bake city.glb -o chosen.umb --max-error 3 --verify 0
check "--max-error says what it chose" grep -q -- '--max-error 3 m: 1024 voxels' err
try 0 umbrage info chosen.umb --json
check "and keeps to it" json out "['lights'][0]['curve'][0]['bound_m'] <= 3 or 1 / 0"
check "but not at twice the price" json out "['lights'][0]['curve'][0]['bound_m'] > 0.9 or 1 / 0"
wanted=$("$BUILD/umbrage" info chosen.umb --quiet)
bake same city.glb --resolution 1024
same "the same resolution gives the same id" "$wanted" "$("$BUILD/umbrage" info same.umb --quiet)"
try 0 umbrage-bake tile city.glb -o tiles --max-error 0.2 --only 0 --json
check "tiles can be had by an error too" test "$(find tiles -name '*.umbt' | wc -l)" = 1
try 0 umbrage-bake city.glb --plan --max-error 0.2
check "--plan tells the costs" grep -q 'of processor time' err
try 2 umbrage-bake city.glb -o none.umb --max-error 0.0001 --quiet
one_sentence "262144 voxels a side, the most"
try 75 umbrage-bake city.glb -o none.umb --max-error 0.02 --memory 100MiB --quiet
one_sentence "too much for --memory"
check "nothing was written" test ! -e none.umb
finish
