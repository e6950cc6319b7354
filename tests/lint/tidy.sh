#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# tidy.sh [FILE...]: clang-tidy with the checks of .clang-tidy on the product's sources (or some of
# them), one file a processor at once. INCLUDES are the -I options of the build.
set -u
cd "$(dirname "$0")/../.."
wanted=14
INCLUDES=${INCLUDES:?make tidy sets it}
export INCLUDES
version=$(clang-tidy --version 2>/dev/null | sed -n 's/.*LLVM version \([0-9]*\).*/\1/p')
if [ "$version" != $wanted ]; then
    echo "tidy: skipped: clang-tidy $wanted is wanted, ${version:-none} is installed (make deps-full installs it)"
    exit 0
fi
[ $# -gt 0 ] || set -- $(git ls-files 'client/*.c' 'proto/*.c' 'server/*.c')
out=$(mktemp) || exit 1
trap 'rm -f "$out"' EXIT
# shellcheck disable=SC2016
printf '%s\n' "$@" | xargs -P "$(nproc)" -n 4 sh -c '
    for file in "$@"; do
        case $file in
        *_avx2.c) extra="-mavx2 -mpopcnt -mbmi -mbmi2" ;;
        *_avx512.c) extra="-mavx2 -mpopcnt -mbmi -mbmi2 -mavx512f -mavx512vl -mavx512bw -mavx512dq -mavx512cd" ;;
        */web_libc.c | *_simd128.c) # of the web package alone
            [ -d /usr/include/wasm32-wasi ] || continue
            extra="--target=wasm32-wasi -msimd128" ;;
        *) extra= ;;
        esac
        clang-tidy --quiet "$file" -- -std=c11 $extra -DNDEBUG -D_POSIX_C_SOURCE=200809L -D_FILE_OFFSET_BITS=64 \
            -DUMB_VERSION=\"0\" $INCLUDES 2>/dev/null
    done' sh >"$out"
if grep -qE '(error|warning):' "$out"; then
    sed "s|$PWD/||" "$out" | awk '/(error|warning):/ { show = !seen[$0]++ } show'
    echo "tidy: the lines above; docs/CONTRIBUTING.md says when NOLINT is right"
    exit 1
fi
echo "tidy: ok ($# files)"
