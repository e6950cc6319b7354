#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The effect `front`: columns of a closed asset with it must have the same answers as those of the
# open asset, line by line. Ids must be equal for all tiles, threads and depth paths. Without the
# effect no byte may be added.
. "$(dirname "$0")/../harness/umbrage_test.sh"

bake() { # OUT OPTION...
    out=$1
    shift
    "$BUILD/umbrage-bake" "$scene" -o "$folder/$out.umb" --json --quiet --verify 0 --sun 140,38 \
        --resolution 512 "$@" >"$folder/json" 2>"$folder/err" || cat "$folder/err" >"$folder/json"
    json "$folder/json" "['asset']"
}

columns() { # FILE
    "$BUILD/umbrage" query "$folder/$1" --columns "$folder/points" 2>"$folder/said"
}

awk 'BEGIN { srand(2); for (i = 0; i < 8000; i++)
    print 200 * rand() - 100, 200 * rand() - 100, 60 * rand() - 10 }' >"$folder/points"

for kind in "city 12" "bridge 30"; do
    name=${kind% *}
    scene=$folder/$name.ply
    "$BUILD/scenegen" "$name" --size "${kind#* }" -o "$scene" 2>/dev/null
    bake open --closed off >/dev/null
    plain=$(bake plain)
    same "$name: front=off is the default" "$plain" "$(bake plain --effect front=off)"
    first=$(bake front --effect front=on)
    columns open.umb >"$folder/open.txt"
    columns front.umb >"$folder/front.txt"
    grep -q '^[0-9-]' "$folder/open.txt" || bad "$name: columns are answered" "$(head -1 "$folder/open.txt")"
    same "$name: columns of the closed asset are those of the open one" \
        "$(cksum <"$folder/open.txt")" "$(cksum <"$folder/front.txt")"
    "$BUILD/umbrage" unpack "$folder/front.umb" -o "$folder/front.umbm" >/dev/null 2>&1
    same "$name: and of its mapped form" "$(cksum <"$folder/open.txt")" \
        "$(columns front.umbm | cksum)"
    same "$name: tiles of 64, 2 threads" "$first" \
        "$(bake other --effect front=on --tile 64 --threads 2)"
    same "$name: tiles of 512" "$first" "$(bake other --effect front=on --tile 512)"
    same "$name: depth by Embree" "$first" \
        "$(bake other --effect front=on --depth embree --tile 256)"
    "$BUILD/umbrage" info "$folder/front.umb" --json >"$folder/info" 2>/dev/null
    "$BUILD/umbrage" info "$folder/plain.umb" --json >"$folder/none" 2>/dev/null
    same "$name: memory counts it" 0 "$(json "$folder/info" "['memory_bytes'] - sum(
        data[p + '_bytes'] for p in ('grid', 'node', 'brick', 'front', 'transmittance'))")"
    for question in segments columns boxes; do
        check "$name: $question agree with rays" "$BUILD/umbrage" verify "$folder/front.umb" \
            --scene "$scene" --ask $question --points 20000 --quiet
    done
    same "$name: off has no byte" 0 "$(json "$folder/none" "['front_bytes']")"
    if grep -q 'effect=closed state=on' "$folder/info"; then
        case $(json "$folder/info" "['front_bytes']") in
        0) bad "$name: on has some" 0 ;;
        *) ok "$name: on has some" ;;
        esac
        grep -q 'effect=front state=on' "$folder/info" && ok "$name: the plan says so" ||
            bad "$name: the plan says so" "$(cat "$folder/info")"
        columns plain.umb >/dev/null
        case $(cat "$folder/said") in
        *"--effect front=on"*) ok "$name: without it columns say what to do" ;;
        *) bad "$name: without it columns say what to do" "$(cat "$folder/said")" ;;
        esac
    fi
done

set -- --tile 128 --cache "$folder/cache"
bake other "$@" >/dev/null
same "$name: a bake with a front takes no tile that has none" "$first" \
    "$(bake other --effect front=on "$@")"
same "$name: of 16" 0 "$(json "$folder/json" "['tiles_found']")"
same "$name: and then those that it kept" "$first" "$(bake other --effect front=on "$@")"
same "$name: all 16" 16 "$(json "$folder/json" "['tiles_found']")"
same "$name: and a bake without front its own" "$plain" "$(bake other "$@")"
same "$name: all 16 as well" 16 "$(json "$folder/json" "['tiles_found']")"
set -- --sun 140,38 --resolution 512 --tile 128 --effect front=on
for only in 0-4 5-15; do
    "$BUILD/umbrage-bake" tile "$scene" -o "$folder/tiles" --only "$only" "$@" --quiet >/dev/null \
        2>"$folder/err" || bad "tiles $only" "$(cat "$folder/err")"
done
"$BUILD/umbrage-bake" merge "$scene" --from "$folder/tiles" -o "$folder/merged.umb" --json --quiet \
    --verify 0 "$@" >"$folder/json" 2>"$folder/err" || cat "$folder/err" >"$folder/json"
same "$name: tiles baked apart merge to the same asset" "$first" \
    "$(json "$folder/json" "['asset']")"
set -- --closed off --effect penumbra=on --tile 128 --cache "$folder/cache-open"
bake other "$@" >/dev/null
bake other "$@" >/dev/null
same "an open scene has no front to keep, and its tiles come from the cache" 16 \
    "$(json "$folder/json" "['tiles_found']")"
finish
