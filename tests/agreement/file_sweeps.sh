#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Checks small assets with every kind of section, in both encodings: every prefix of a file, and the
# file with any bit flipped, must be refused. `make file-sweeps` runs it; the unit tests do the same
# for a file of one light.
set -e
BUILD=${BUILD:-build/release}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$BUILD/scenegen" city --size 2 -o "$folder/city.ply" 2>/dev/null
printf 'newmtl pane\nd 0.4\nnewmtl wall\n' >"$folder/glass.mtl"
printf '%s\n' 'mtllib glass.mtl' 'v 0 0 2' 'v 3 0 2' 'v 3 3 2' 'v 0 3 2' 'usemtl pane' 'f 1 2 3 4' \
    'v 5 0 0' 'v 8 0 0' 'v 8 3 3' 'usemtl wall' 'f 5 6 7' >"$folder/glass.obj"
bake() { # NAME SCENE OPTION...
    name=$1 scene=$2
    shift 2
    "$BUILD/umbrage-bake" "$folder/$scene" -o "$folder/$name.umb" --quiet --verify 0 "$@"
    "$BUILD/umbrage" unpack "$folder/$name.umb" -o "$folder/$name.umbm" --quiet
}
bake front city.ply --sun 140,38 --resolution 128 --effect front=on
bake lights city.ply --sun 140,38 --sun 200,50 --point 3,5,25 --resolution 64 --closed off
bake panes glass.obj --sun 140,60 --resolution 64
"$BUILD/file_sweep" "$folder"/*.umb "$folder"/*.umbm
