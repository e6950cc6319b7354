#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Are the tools of the package `umbrage` here? 0 if this compiler makes WebAssembly with a C library; else 1, and one
# line names what is missing.
#
#   client/web/tools.sh CLANG
set -u
folder=$(mktemp -d) || exit 1
trap 'rm -rf "$folder"' EXIT
printf '#include <stdlib.h>\nlong double half(long double x) { return free(0), x / 2; }\n' >"$folder/try.c"
# A command with words, such as "ccache clang".
# shellcheck disable=SC2086
if ! $1 --target=wasm32-wasi -mexec-model=reactor -Wl,--export=half "$folder/try.c" -o "$folder/try.wasm" 2>/dev/null; then
    echo "clang, lld, wasi-libc or libclang-rt-dev-wasm32 is not installed (make deps-full installs them)"
    exit 1
fi
