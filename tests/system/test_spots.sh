#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Spot and point lights: every voxel of every face must agree with lit and end found by brute force,
# both depth paths must give one id, and points must agree with rays traced to the light.
. "$(dirname "$0")/../harness/umbrage_test.sh"

exhaust() { # KIND SIZE RULE LIGHT...
    kind=$1 size=$2 rule=$3
    shift 3
    scene=$folder/$kind-$size.ply
    [ -f "$scene" ] || "$BUILD/scenegen" "$kind" --size "$size" -o "$scene" 2>/dev/null
    name="$kind $size, closed $rule, $*"
    if ! "$BUILD/umbrage-bake" "$scene" -o "$folder/a.umb" --resolution 128 --closed "$rule" \
        --quiet --verify 4000 "$@" 2>"$folder/err" ||
        ! "$BUILD/umbrage" unpack "$folder/a.umb" -o "$folder/a.umbm" --quiet 2>"$folder/err"; then
        bad "$name" "$(cat "$folder/err")"
        return
    fi
    if "$BUILD/oracle_check" "$folder/a.umb" "$folder/a.umbm" --scene "$scene" --json \
        >"$folder/out" 2>"$folder/err" && [ "$(json "$folder/out" "['wrong']")" = 0 ]; then
        ok "$name: $(cat "$folder/out")"
    else
        bad "$name" "$(cat "$folder/out" "$folder/err" | tail -n 12)"
    fi
}

exhaust city 8 auto --point 0.31,-0.17,30.13
exhaust city 8 auto --spot 0,0,60,0.3,0.2,-1,40 --sun 135,45
exhaust city 8 auto --spot 10,5,20,1,0.2,-0.1,85
exhaust terrain 64 auto --spot 31.7,-12.3,2000,0.01,0.02,-1,30
exhaust box 10 auto --point 3,4,0.5 # within the box: nothing reaches the outside
exhaust arch 3 off --point 1.13,-5.27,2.31

id() { # OPTION...: the asset's id, baked with all kinds of lights
    "$BUILD/umbrage-bake" "$folder/city-8.ply" -o "$folder/b.umb" --resolution 256 --json --quiet \
        --point 0,0,30 --spot 0,0,60,0.3,0.2,-1,40 --sun 20,30 --verify 0 "$@" >"$folder/out" &&
        json "$folder/out" "['asset']"
}
wanted=$(id --threads 1 --tile 64)
same "threads and tiles leave the id alone" "$wanted" "$(id --threads 2 --tile 128)"
same "Embree's candidates give the same voxels" "$wanted" "$(id --depth embree --threads 2)"

check "verified against rays from the scene" \
    "$BUILD/umbrage" verify "$folder/b.umb" --scene "$folder/city-8.ply" --points 20000
"$BUILD/umbrage-bake" "$folder/city-8.ply" -o "$folder/p.umb" --resolution 512 --quiet \
    --point 60.3,-40.2,80.5 --verify 1000
"$BUILD/umbrage-study" render "$folder/city-8.ply" --asset "$folder/p.umb" -o "$folder/p.png" \
    --size 256x144 --filter box --taps 5 --compare --quiet --json >"$folder/out"
# Measured: 0.00065; twice that is allowed.
check "a picture under a point light equals the traced one: $(json "$folder/out" "['mean_defined']")" \
    test "$(json "$folder/out" "['mean_defined'] < 0.0013")" = True
same "info lists the lights with their kinds" "directional point spot" \
    "$("$BUILD/umbrage" info "$folder/b.umb" | sed -n "s/^light [0-9]* *\([a-z]*\) .*/\1/p" | sort | tr '\n' ' ' | sed 's/ $//')"
"$BUILD/umbrage-bake" "$folder/city-8.ply" --plan --point 0,0,30 --resolution 256 >"$folder/out"
check "the plan says why there are faces" \
    grep -q 'effect=faces state=on reason="1 spot or point lights see casters in' "$folder/out"
finish
