#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Compares the libraries with those of the last tag v*: their records (tests/abi/abi.py) and, where
# abidiff is installed, the shared libraries themselves. A new SONAME starts anew.
#
#   last_tag.sh BUILD    BUILD has the shared libraries; the tag's are built below BUILD/abi
set -eu
cd "$(dirname "$0")/../.."
build=$1
if ! tag=$(git describe --tags --abbrev=0 --match 'v[0-9]*' 2>/dev/null); then
    echo "abi: skipped: there is no tag v* yet"
    exit 0
fi
old=$build/abi/$tag
mkdir -p "$old"
git show "$tag:tests/abi/record.txt" >"$old/record.txt"
tests/abi/abi.py keeps "$old/record.txt"
echo "abi: the record keeps what $tag promises"
if ! command -v abidiff >/dev/null; then
    echo "abi: abidiff skipped: it is not installed (abigail-tools has it)"
    exit 0
fi
git archive "$tag" | tar -x -C "$old"
make -C "$old" --no-print-directory BUILD=build/abi libraries >"$old/make.log" 2>&1 || {
    tail -n 20 "$old/make.log"
    exit 1
}
for library in "$build"/lib*.so.*; do
    name=$(basename "$library")
    [ -e "$old/build/abi/$name" ] || continue
    # Types that grew into reserved words are changes, too: grown.suppr names those that may.
    abidiff --no-added-syms --headers-dir1 "$old/client/include" --headers-dir2 client/include \
        $([ -e tests/abi/grown.suppr ] && echo --suppressions tests/abi/grown.suppr) \
        "$old/build/abi/$name" "$library" >"$old/$name.txt" || {
        cat "$old/$name.txt"
        echo "abi: $name differs from the one of $tag. If each change above only grows a struct into" \
            "its reserved words, name these structs in tests/abi/grown.suppr (man libabigail)"
        exit 1
    }
    echo "abi: $name runs programs that were linked with the one of $tag"
done
