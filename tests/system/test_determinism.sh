#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# One scene and one set of settings have one id: for any thread count, tile size, memory, depth path
# and repetition, and the same triangles as OBJ or as PLY; other settings have another id. The short
# form of `make determinism`, which takes more of each, and other compilers.
. "$(dirname "$0")/../harness/umbrage_test.sh"

id_of() { # SCENE OPTION...
    scene=$1
    shift
    if "$BUILD/umbrage-bake" "$scene" -o "$folder/a.umb" --json --quiet --verify 0 \
        --sun 140,38 "$@" >"$folder/out" 2>"$folder/err"; then
        json "$folder/out" "['asset']"
    else
        echo "failed: $(cat "$folder/err")"
    fi
}

awk 'BEGIN { srand(1); for (i = 0; i < 8000; i++)
    print 400 * rand() - 200, 400 * rand() - 200, 60 * rand() - 10 }' >"$folder/points"

for kind in "city 12 1024" "terrain 128 512" "arch 4 1024" "bridge 30 512"; do
    name=${kind% * *} size=${kind% *} side=${kind##* }
    for form in obj ply glb; do
        "$BUILD/scenegen" "$name" --size "${size#* }" -o "$folder/$name.$form" 2>/dev/null
    done
    scene=$folder/$name.ply
    first=$(id_of "$scene" --resolution "$side" --threads 1)
    cp "$folder/a.umb" "$folder/first.umb"
    case $first in
    [0-9a-f]*) ;;
    *) bad "$name bakes" "$first" ;;
    esac
    same "$name: again" "$first" "$(id_of "$scene" --resolution "$side" --threads 1)"
    same "$name: tiles of 64, 2 threads" "$first" \
        "$(id_of "$scene" --resolution "$side" --tile 64 --threads 2)"
    same "$name: one tile, 4 threads" "$first" \
        "$(id_of "$scene" --resolution "$side" --tile "$side" --threads 4)"
    same "$name: less memory" "$first" "$(id_of "$scene" --resolution "$side" --memory 300MiB)"
    same "$name: depth by the portable rasteriser, 4 threads" "$first" \
        "$(id_of "$scene" --resolution "$side" --depth plain --threads 4)"
    same "$name: depth by Embree, small tiles, 3 threads" "$first" \
        "$(id_of "$scene" --resolution "$side" --depth embree --tile 256 --threads 3)"
    same "$name: OBJ has the id of PLY" "$first" \
        "$(id_of "$folder/$name.obj" --resolution "$side" --threads 1)"
    cp "$folder/a.umb" "$folder/obj.umb"
    # GLB holds floats in y-up axes: another scene by bits, but always the same one.
    glb=$(id_of "$folder/$name.glb" --resolution "$side" --threads 1)
    same "$name: GLB, 4 threads, tiles of 128" "$glb" \
        "$(id_of "$folder/$name.glb" --resolution "$side" --threads 4 --tile 128)"
    for other in "--resolution 256" "--resolution $side --closed off" "--resolution $side --up y"; do
        # shellcheck disable=SC2086
        id=$(id_of "$scene" $other)
        if [ "$id" = "$first" ] && [ "$name $other" != "arch --resolution $side --closed off" ]; then
            bad "$name: $other has another id" "$id"
        else
            ok "$name: $other has another id"
        fi
    done
    # Files of one id differ in their notes (times, writer) only; the packed pages are the same.
    "$BUILD/umbrage" unpack "$folder/first.umb" -o "$folder/first.umbm" --quiet
    id_of "$scene" --resolution "$side" --threads 4 --tile 256 >/dev/null
    "$BUILD/umbrage" unpack "$folder/a.umb" -o "$folder/a.umbm" --quiet
    for file in first.umb a.umb obj.umb first.umbm a.umbm; do
        "$BUILD/umbrage" query "$folder/$file" --points "$folder/points" --taps 9 --quiet \
            >"$folder/answers.$file"
        check "$name: $file answers as first.umb does" \
            cmp "$folder/answers.first.umb" "$folder/answers.$file"
    done
    same "$name: 8000 answers" 8000 "$(wc -l <"$folder/answers.first.umb" | tr -d ' ')"
done
finish
