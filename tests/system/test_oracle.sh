#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The defined voxels of generated scenes equal lit and end, open and closed, packed and mapped,
# through a second reader written from docs/reference/umb-format.md and depths found by brute force.
. "$(dirname "$0")/../harness/umbrage_test.sh"

step=1 # every step-th column in x and y
exhaust() { # KIND SIZE RESOLUTION RULE [BAKE OPTION]...
    kind=$1 size=$2 resolution=$3 rule=$4
    shift 4
    scene=$folder/$kind-$size.ply
    [ -f "$scene" ] || "$BUILD/scenegen" "$kind" --size "$size" -o "$scene" 2>/dev/null
    name="$kind $size at $resolution, closed $rule $*"
    if ! "$BUILD/umbrage-bake" "$scene" -o "$folder/a.umb" --resolution "$resolution" \
        --closed "$rule" --quiet --verify 1000 "$@" 2>"$folder/err" ||
        ! "$BUILD/umbrage" unpack "$folder/a.umb" -o "$folder/a.umbm" --quiet 2>"$folder/err"; then
        bad "$name" "$(cat "$folder/err")"
        return
    fi
    if "$BUILD/oracle_check" "$folder/a.umb" "$folder/a.umbm" --scene "$scene" --step $step --json \
        >"$folder/out" 2>"$folder/err" && [ "$(json "$folder/out" "['wrong']")" = 0 ]; then
        ok "$name: $(cat "$folder/out")"
    else
        bad "$name" "$(cat "$folder/out" "$folder/err" | tail -n 12)"
    fi
}

for rule in auto off; do
    exhaust city 8 256 $rule --sun 135,45
    exhaust terrain 64 256 $rule --sun 200,25
    exhaust arch 3 256 $rule --sun 100,60
done
# One level more. The city of 512 voxels below is compared whole.
step=3
exhaust city 8 512 off --sun 135,45
exhaust terrain 64 512 auto --sun 200,25
exhaust arch 3 512 auto --sun 100,60
step=1
exhaust bridge 20 256 auto --sun 170,35
exhaust sphere 8 256 auto --sun 10,80
exhaust box 10 256 auto --sun 20,70
exhaust city 8 256 auto --sun 135,45 --depth embree --tile 128 --threads 2
exhaust terrain 64 256 auto --sun 95,3
# Faces of lamps, in a hall whose closed parts meet open ones.
exhaust hall 2 64 auto --area 0.13,0.07,5.03,0.1,0.05,-1,2,1
exhaust hall 1 128 auto --area 0,0,5,0,0,-1,2,1 --area 1,-2,4,0.3,0.2,-1,0.8
exhaust hall 2 128 auto --spot 0.13,0.07,5.03,0.1,0.05,-1,90
exhaust hall 2 128 off --area 0.13,0.07,5.03,0.1,0.05,-1,2,1
exhaust city 8 512 auto --sun 135,45 --effect front=on
exhaust sphere 8 256 auto --sun 10,80 --effect front=on
case $(json "$folder/out" "['fronts']") in
65536) ok "every texel's first occluder was compared" ;;
*) bad "every texel's first occluder was compared" "$(cat "$folder/out")" ;;
esac

# The oracle itself must be able to fail: it compares a file with another scene.
"$BUILD/scenegen" city --size 8 --seed 2 -o "$folder/other.ply" 2>/dev/null
"$BUILD/umbrage-bake" "$folder/city-8.ply" -o "$folder/a.umb" --resolution 256 --quiet --verify 0
if "$BUILD/oracle_check" "$folder/a.umb" --scene "$folder/other.ply" >"$folder/out" 2>&1; then
    bad "the oracle finds fault with another scene's file" "$(tail -n 3 "$folder/out")"
else
    ok "the oracle finds fault with another scene's file"
fi
finish
