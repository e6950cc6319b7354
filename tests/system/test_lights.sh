#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Several lights in one asset: every voxel of every frustum is right, each light answers as it does
# alone, and what they share is stored once.
. "$(dirname "$0")/../harness/umbrage_test.sh"

bake() { # OUT OPTION...
    out=$folder/$1
    shift
    "$BUILD/umbrage-bake" "$scene" -o "$out" --resolution 256 --quiet "$@" 2>"$folder/err" ||
        bad "bake $*" "$(cat "$folder/err")"
}

exact() { # FILE: every defined voxel of every frustum, packed and mapped
    "$BUILD/umbrage" unpack "$folder/$1" -o "$folder/mapped.umbm" --quiet
    if "$BUILD/oracle_check" "$folder/$1" "$folder/mapped.umbm" --scene "$scene" --json \
        >"$folder/out" 2>"$folder/err"; then
        ok "$1: $(cat "$folder/out")"
    else
        bad "$1: every voxel" "$(cat "$folder/out" "$folder/err" | tail -n 5)"
    fi
}

scene=$folder/city.ply
"$BUILD/scenegen" city --size 8 -o "$scene" 2>/dev/null
bake three.umb --sun 135,45 --sun 135,46 --sun 250,20 --verify 60000 --threads 2
bake first.umb --sun 135,45 --verify 1000
bake second.umb --sun 135,46 --verify 1000
bake third.umb --sun 250,20 --verify 1000
exact three.umb
same "info lists three lights" 3 "$("$BUILD/umbrage" info "$folder/three.umb" | grep -c '^light ')"

"$BUILD/umbrage-study" points "$scene" --kind near --reach 2 --count 20000 --format f64 \
    -o "$folder/points" --quiet
for light in 0 1 2; do
    alone=$(echo first second third | cut -d ' ' -f $((light + 1)))
    "$BUILD/umbrage" query "$folder/three.umb" --light $light --points "$folder/points" \
        --format f64 --taps 5 --quiet >"$folder/together"
    "$BUILD/umbrage" query "$folder/$alone.umb" --points "$folder/points" \
        --format f64 --taps 5 --quiet >"$folder/alone"
    same "light $light answers as it does alone" "$(cksum <"$folder/alone")" \
        "$(cksum <"$folder/together")"
done
check "the lights' answers differ" test "$(wc -l <"$folder/alone")" = 20000
together=$(wc -c <"$folder/three.umb")
apart=$(cat "$folder/first.umb" "$folder/second.umb" "$folder/third.umb" | wc -c)
check "three suns in one file take less than apart: $together of $apart bytes" \
    test "$together" -lt "$apart"

bake path.umb --sun-path 52,4.4,2026-06-21,120 --verify 20000
exact path.umb
same "a day of suns every two hours" 9 "$("$BUILD/umbrage" info "$folder/path.umb" | grep -c '^light ')"
bake again.umb --sun-path 52,4.4,2026-06-21,120 --verify 0 --threads 2 --tile 64
same "and its id does not depend on threads and tiles" \
    "$("$BUILD/umbrage" info "$folder/path.umb" --json | sed 's/.*"asset":"\([0-9a-f]*\)".*/\1/')" \
    "$("$BUILD/umbrage" info "$folder/again.umb" --json | sed 's/.*"asset":"\([0-9a-f]*\)".*/\1/')"
finish
