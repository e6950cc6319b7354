#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# An effect that is off must cost a query nothing. The test compares the instructions a point of
# umb_query_run over a sun's asset without effects, counted by valgrind, with every effect in the
# program and with one of them compiled out (client/core/query/query.c). A difference above 0.1 %
# fails. Both programs come from one compiler, so no expected figures are stored.
set -eu
: "${BUILD:=build/release}"

skip() {
    echo "$1"
    exit 77
}
command -v valgrind >/dev/null || skip "no valgrind"

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$BUILD/kernel_count" write "$folder/ground.umbm"

# Instructions a point of PROGRAM with TAPS taps.
count() {
    points=$(valgrind --tool=callgrind --callgrind-out-file="$folder/out" \
        --toggle-collect=umb_query_run "$1" run "$folder/ground.umbm" query "$2" \
        2>"$folder/log" | sed -n 's/^points=\([0-9]*\).*/\1/p')
    sed -n 's/.*Collected *: *\([0-9]*\).*/\1/p' "$folder/log" |
        awk -v p="$points" '{ printf "%.4f", $1 / p }'
}

failures=0 compared=0
for taps in 1 9; do
    all=$(count "$BUILD/kernel_count" $taps)
    for program in "$BUILD"/kernel_count_without_*; do
        less=$(count "$program" $taps)
        verdict=$(awk -v a="$all" -v b="$less" 'BEGIN {
            d = (a - b) / b; printf "%+.4f %%: %s", 100 * d,
            (b > 0 && d <= 0.001 && d >= -0.001) ? "ok" : "NOT NOTHING" }')
        echo "$taps taps: $all instructions a point, $less without ${program##*_}, $verdict"
        compared=$((compared + 1))
        case $verdict in *ok) ;; *) failures=$((failures + 1)) ;; esac
    done
done
[ "$compared" -gt 1 ] || { echo "no program without an effect was built"; exit 1; }
exit "$failures"
