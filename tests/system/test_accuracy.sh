#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# False shadow and false light with the automatic bias, at points that cameras see of a terrain and
# a city and whose cosine with the light is above 0.2.
#
# False shadow: the asset says below 0.5 where rays spread over the filter's area say above 0.5 by
# more than their own error. False light: the asset says above 0.5 where a ray from the surface
# itself is blocked. A filter widens the light on purpose, so its bounds are those measured with a
# prototype on scenes of the same kind and size (voxels a side). UMBRAGE_ACCURACY=full (make
# accuracy): millions of triangles, 4096 and 16384 voxels, open and closed; its rows are the table
# of docs/results/accuracy.md.
. "$(dirname "$0")/../harness/umbrage_test.sh"
mode=${UMBRAGE_ACCURACY:-short}
if [ "$mode" = full ]; then
    views="az=60 az=240,el=60"
    resolutions="4096 16384" size=480x270 terrain=1024 city=50
else
    views="az=60 az=240,el=60"
    resolutions=4096 size=240x135 terrain=128 city=12
fi

# Shares in percent; the first number is the bound of false shadow.
bounds() { # KIND RESOLUTION TAPS
    case $1-$2-$3 in
    terrain-4096-1) echo 0.05 0.21 ;;
    terrain-4096-9) echo 0.05 1.08 ;;
    terrain-4096-17) echo 0.05 1.57 ;;
    terrain-16384-1) echo 0.05 0.07 ;;
    terrain-16384-9) echo 0.05 0.40 ;;
    terrain-16384-17) echo 0.05 0.64 ;;
    city-4096-1) echo 0.3 0.86 ;;
    city-4096-9) echo 0.3 8.6 ;;
    city-4096-17) echo 0.3 12.5 ;;
    city-16384-1) echo 0.3 0.25 ;;
    city-16384-9) echo 0.3 1.72 ;;
    city-16384-17) echo 0.3 5.3 ;;
    esac
}

# Judged samples and wrong ones of all views, in one line: JUDGED WRONG.
count() { # KEY NAME SCENE OPTION...
    key=$1 name=$2 scene=$3
    shift 3
    for view in $views; do
        "$BUILD/umbrage" render "$scene" --asset "$folder/$name.umb" --compare --size $size --aa 1 \
            --camera "$view" --filter box --json "$@" 2>"$folder/err" || cat "$folder/err" >&2
    done >"$folder/lines"
    /usr/bin/python3 -c '
import json, sys
rows = [json.loads(line) for line in open(sys.argv[2])]
judged = sum(row["judged"] for row in rows)
print(judged, round(sum(row[sys.argv[1]] * row["judged"] for row in rows)))' "$key" "$folder/lines"
}

below() { # SENTENCE JUDGED WRONG BOUND
    if awk -v n="$2" -v wrong="$3" -v bound="$4" \
        'BEGIN { exit !(n > 5000 && 100 * wrong / n <= bound) }'; then
        ok "$1: $3 of $2, at most $4 %"
    else
        bad "$1" "$3 of $2 samples, more than $4 %"
    fi
}

judge() { # KIND SCENE RESOLUTION CLOSED
    kind=$1 scene=$2 resolution=$3 name=$1-$3-$4
    "$BUILD/umbrage-bake" "$scene" -o "$folder/$name.umb" --resolution "$resolution" --closed "$4" \
        --verify 0 --quiet 2>"$folder/err" || bad "$name bakes" "$(cat "$folder/err")"
    for taps in 1 9 17; do
        # shellcheck disable=SC2046
        set -- $(count false_shadow "$name" "$scene" --taps $taps --truth area --samples 8) \
            $(count false_light "$name" "$scene" --taps $taps --truth surface) \
            $(bounds "$kind" "$resolution" $taps)
        below "$name, $taps taps: false shadow" "$1" "$2" "$5"
        below "$name, $taps taps: false light" "$3" "$4" "$6"
    done
}

"$BUILD/scenegen" terrain --size $terrain -o "$folder/terrain.ply" 2>/dev/null
"$BUILD/scenegen" city --size $city -o "$folder/city.glb" 2>/dev/null
for resolution in $resolutions; do
    judge terrain "$folder/terrain.ply" $resolution off
    judge city "$folder/city.glb" $resolution off
    if [ "$mode" = full ]; then
        judge terrain "$folder/terrain.ply" $resolution auto
        judge city "$folder/city.glb" $resolution auto
    fi
done

# The bounds must be able to fail: without bias a surface shadows itself.
# shellcheck disable=SC2046
set -- $(count false_shadow city-4096-off "$folder/city.glb" --taps 1 --truth surface --bias none)
if awk -v n="$1" -v wrong="$2" 'BEGIN { exit !(n > 5000 && 100 * wrong / n > 0.3) }'; then
    ok "without bias the city is over the bound: $2 of $1"
else
    bad "without bias the city is over the bound" "$2 of $1"
fi
finish
