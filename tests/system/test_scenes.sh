#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Scenes from outside this project, from ${UMBRAGE_SCENES:-../shared/scenes}: each one that can be
# imported bakes at 2048^3 and agrees with traced rays outside of the boundary band; scenes with
# closed parts under all three settings of the closed rule. Files that hold no mesh exit with 65 and
# one sentence that says why.
. "$(dirname "$0")/../harness/umbrage_test.sh"
scenes=${UMBRAGE_SCENES:-$root/../shared/scenes}
if [ ! -d "$scenes" ]; then
    echo "skipped: no folder $scenes (set UMBRAGE_SCENES)"
    exit 77
fi
# Half of them near boundaries. 300 000 points find a wrong region of 1e-5 of the lit surface with a
# probability of 95 %; the full million of `verify` is for people.
POINTS=300000

# Bakes at 2048 with a chosen sun; the bake's own check and `verify` must find no wrong point
# outside the band.
bakes() { # SCENE [BAKE OPTION]...
    scene=$1
    shift
    name="$scene $*"
    if ! timeout 120 "$BUILD/umbrage-bake" "$scenes/$scene" -o "$folder/a.umb" --resolution 2048 \
        --quiet --verify 0 --json "$@" >"$folder/bake" 2>"$folder/err"; then
        bad "$name bakes" "$(cat "$folder/err")"
        return
    fi
    timeout 240 "$BUILD/umbrage" verify "$folder/a.umb" --scene "$scenes/$scene" --points $POINTS \
        --json >"$folder/out" 2>"$folder/err"
    code=$?
    if [ $code -ne 0 ]; then
        bad "$name agrees with rays" "exit code $code: $(cat "$folder/out" "$folder/err")"
        return
    fi
    outside=$(json "$folder/out" "['lights'][0]['outside_band']")
    compared=$(json "$folder/out" "['lights'][0]['points']")
    if [ "$outside" = 0 ] && [ "$compared" -ge $((POINTS / 2)) ]; then
        ok "$name: closed $(json "$folder/bake" "['closed']"), $compared points, in the band" \
            "$(json "$folder/out" "['lights'][0]['inside_band']")"
    else
        bad "$name agrees with rays" "$outside outside of the band, $compared points compared"
    fi
}

sun="--sun 150,40"
while read -r scene rules light; do
    [ "$light" = file ] && choice= || choice=$sun
    for rule in $(echo "$rules" | tr , ' '); do
        # shellcheck disable=SC2086
        bakes "$scene" --closed "$rule" $choice
    done
done <"$root/tests/scenes/real_scenes.txt"

# The check must be able to fail: another scene's asset must not agree.
banana=$scenes/scan_ycb_banana/textured_simple_reoriented.obj
if "$BUILD/umbrage" verify "$folder/a.umb" --scene "$banana" --force --points 20000 \
    >"$folder/out" 2>&1; then
    bad "an asset of another scene is found out" "$(cat "$folder/out")"
else
    ok "an asset of another scene is found out"
fi

for file in empty.obj empty.ply empty.stl empty_nodes.glb obj_points.obj ply_empty_header.ply \
    points_emptyface.ply stl_empty_bin.stl; do
    rm -f "$folder/no.umb"
    try 65 umbrage-bake "$scenes/broken_trimesh/$file" -o "$folder/no.umb" $sun
    one_sentence "$file"
    echo "    $(cat "$folder/err")"
    check "  no output" test ! -e "$folder/no.umb"
done
finish
