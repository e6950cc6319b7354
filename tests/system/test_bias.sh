#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The shadows that the automatic bias loses: false light and false shadow on houses with eaves and
# recessed doors, under three suns, at points that a camera sees and whose cosine with the sun is
# above 0.2. Voxels are as wide as those of the town of docs/results/biases.md: 0.09 m. `make
# bias-table` measures five scenes and the rejected biases.
. "$(dirname "$0")/../harness/umbrage_test.sh"

"$BUILD/scenegen" houses --size 6 -o "$folder/houses.glb" 2>/dev/null

share() { # KEY SUN OPTION...: pictures of equal options are drawn once
    key=$1 sun=$2 row=$folder/row-$(echo "$*" | cut -d' ' -f2- | tr ' ' _)
    shift 2
    [ -s "$row" ] || "$BUILD/umbrage" render "$folder/houses.glb" --asset "$folder/$sun.umb" \
        --compare --aa 1 --json "$@" >"$row" 2>"$folder/err" || cat "$folder/err" >&2
    /usr/bin/python3 -c '
import json, sys
row = json.load(open(sys.argv[2]))
assert row["judged"] > 5000, row
print(f"{100 * row[sys.argv[1]]:.3f}")' "$key" "$row"
}

below() { # SENTENCE SHARE BOUND
    if awk -v share="$2" -v bound="$3" 'BEGIN { exit !(share <= bound) }'; then
        ok "$1: $2 %, at most $3 %"
    else
        bad "$1" "$2 %, more than $3 %"
    fi
}

for sun in 70 45 15; do
    "$BUILD/umbrage-bake" "$folder/houses.glb" -o "$folder/$sun.umb" --resolution 2048 --closed off \
        --sun 135,$sun --verify 0 --quiet 2>"$folder/err" || bad "sun $sun bakes" "$(cat "$folder/err")"
    high="sun $sun degrees high"

    # A picture by defaults, compared with single rays. The bounds are those that pictures are held
    # to (docs/decisions/0002-automatic-bias.md).
    below "$high, a default picture: false light" "$(share false_light $sun)" 0.5
    below "$high, a default picture: false shadow" "$(share false_shadow $sun)" 0.1
    set -- --size 640x360 --truth footprint --samples 4
    below "$high, against its footprints: false light" "$(share false_light $sun "$@")" 0.5
    below "$high, against its footprints: false shadow" "$(share false_shadow $sun "$@")" 0.1

    # Windows. False shadow is judged by rays over the window's own area, as in test_accuracy.sh.
    # 6 voxels along the normal are the reach that 9 taps need on a plane at 45 degrees: lifts along
    # the light must lose at most half as much.
    set -- --size 320x180 --filter box
    below "$high, one tap: false light" "$(share false_light $sun "$@" --taps 1 --truth surface)" 0.25
    for taps in 1 9; do
        below "$high, $taps taps: false shadow" \
            "$(share false_shadow $sun "$@" --taps $taps --truth area --samples 8)" 0.1
    done
    moved=$(share false_light $sun "$@" --taps 9 --truth surface --bias 6vox)
    below "$high, 9 taps: false light" "$(share false_light $sun "$@" --taps 9 --truth surface)" \
        "$(awk -v share="$moved" 'BEGIN { print share / 2 }')"
done

# Rays over footprints: one is the ray from the surface, and the filter is nearer to many, by a
# fifth at this size. The bound leaves a quarter of that for other cameras.
difference() { # OPTION...
    share mean_difference 45 --size 320x180 "$@"
}
same "one ray over a footprint is the ray from the surface" "$(difference --truth surface)" \
    "$(difference --truth footprint --samples 1)"
below "a footprint's mean difference from 64 rays over it" \
    "$(difference --truth footprint --samples 8)" \
    "$(difference --truth surface | awk '{ print 0.85 * $1 }')"
finish
