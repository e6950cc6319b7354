#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What a page costs that is added to a partial asset or dropped, with the build that follows: the
# instructions, counted by valgrind, at 10, 100 and 1000 pages held. More than 20 % between any two
# fails. All counts come from one compiler, so that no figure is expected.
set -eu
: "${BUILD:=build/release}"

command -v valgrind >/dev/null || {
    echo "no valgrind"
    exit 77
}

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$BUILD/page_count" write "$folder/pages.umb"

# Instructions a page of FUNCTION with HELD pages.
count() {
    pages=$(valgrind --tool=callgrind --callgrind-out-file="$folder/out" --collect-atstart=no \
        --toggle-collect="$1" "$BUILD/page_count" run "$folder/pages.umb" "$2" \
        2>"$folder/log" | sed -n 's/^pages=\([0-9]*\).*/\1/p')
    sed -n 's/.*Collected *: *\([0-9]*\).*/\1/p' "$folder/log" |
        awk -v p="$pages" '{ printf "%.0f", $1 / p }'
}

failures=0
for function in page_come page_go; do
    few=$(count $function 10)
    for held in 100 1000; do
        many=$(count $function $held)
        verdict=$(awk -v a="$few" -v b="$many" 'BEGIN {
            print (a > 0 && b > 0 && b / a <= 1.2 && a / b <= 1.2) ? "ok" : "NOT THE SAME" }')
        echo "$function: $few instructions a page at 10 pages held, $many at $held: $verdict"
        [ "$verdict" = ok ] || failures=$((failures + 1))
    done
done
exit "$failures"
