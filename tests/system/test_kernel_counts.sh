#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Instructions a point of every query kernel, counted by valgrind. A count more than 3 % above the
# figure in tests/bench/kernel_counts.tsv fails. Change the figure in the commit that changes the
# kernel. Counts belong to one compiler and its options, so that other builds are left out.
set -eu
: "${BUILD:=build/release}"
expected=$(dirname "$0")/../bench/kernel_counts.tsv

skip() {
    echo "$1"
    exit 77
}
command -v valgrind >/dev/null || skip "no valgrind"
command -v readelf >/dev/null || skip "no readelf"
grep -qw avx2 /proc/cpuinfo || skip "no AVX2"
compiler=$(sed -n 's/^# compiler: //p' "$expected")
readelf -p .comment "$BUILD/kernel_count" | grep -q "$compiler" || skip "not built by $compiler"
readelf --debug-dump=info "$BUILD/kernel_count" 2>/dev/null | grep -m 1 -q 'DW_AT_producer.*-O2' ||
    skip "not a release build"

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$BUILD/kernel_count" write "$folder/ground.umbm"
failures=0
while read -r kernel taps figure; do
    case $kernel in '#'* | '') continue ;; esac
    # Footprints are a stage around kernels, so instructions of the whole query are counted.
    case $kernel in *footprint_* | lamp_*) counted=umb_query_run ;; tent_*) counted=umb__$kernel ;; *) counted=umb__kernel_$kernel ;; esac
    points=$(valgrind --tool=callgrind --callgrind-out-file="$folder/out" \
        --toggle-collect="$counted" \
        "$BUILD/kernel_count" run "$folder/ground.umbm" "$kernel" "$taps" 2>"$folder/log" |
        sed -n 's/^points=\([0-9]*\).*/\1/p')
    count=$(sed -n 's/.*Collected *: *\([0-9]*\).*/\1/p' "$folder/log")
    verdict=$(awk -v c="$count" -v p="$points" -v f="$figure" 'BEGIN {
        n = c / p; printf "%.1f instructions a point, expected %s: %s", n, f,
        (n > 1.03 * f) ? "TOO MANY" : (n < 0.9 * f) ? "TOO FEW: measured something else, or update the table" : "ok" }')
    echo "$kernel, $taps taps: $verdict"
    case $verdict in *"ok") ;; *) failures=$((failures + 1)) ;; esac
done <"$expected"
exit "$failures"
