#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The effect `transmittance`: behind panes of glass the light must be the product of what they let
# through, in answers of the file, its mapped form and the daemon. Ids must be equal for any number
# of threads and tiles. With the effect off, and for opaque materials, the asset must hold no
# transmittance.
. "$(dirname "$0")/../harness/umbrage_test.sh"

# A ground, panes at heights 4 and 6 over parts of it, and an opaque roof at 8 over another part.
# pane TOP OPACITY: opacity of the lower one is 0.4.
scene() { # FILE OPACITY
    printf 'newmtl ground\nnewmtl lower\nd 0.4\nnewmtl upper\nd %s\n' "$2" >"$folder/$1.mtl"
    cat >"$folder/$1.obj" <<END
mtllib $1.mtl
v -9 -9 0
v 9 -9 0
v 9 9 0
v -9 9 0
v -6 -6 4
v 2 -6 4
v 2 2 4
v -6 2 4
v -2 -6 6
v 6 -6 6
v 6 2 6
v -2 2 6
v -6 4 8
v 6 4 8
v 6 8 8
v -6 8 8
usemtl ground
f 1 2 3 4
f 13 14 15 16
usemtl lower
f 5 6 7 8
usemtl upper
f 9 10 11 12
END
}

bake() { # OUT OPTION...
    out=$1
    shift
    "$BUILD/umbrage-bake" "$folder/${scene:-glass}.obj" -o "$folder/$out.umb" --json --quiet \
        --verify 100000 --sun 0,90 --resolution 256 "$@" >"$folder/json" 2>"$folder/err" ||
        cat "$folder/err" >"$folder/json"
    json "$folder/json" "['asset']"
}

# In no shadow, in that of the lower pane, of both, of the upper pane, and of the roof; and above
# the lower pane.
cat >"$folder/points" <<END
8 0 0.1
-4 -2 0.1
0 -2 0.1
4 -2 0.1
0 6 0.1
-4 -2 4.5
END
answers() { # FILE OPTION...
    file=$1
    shift
    "$BUILD/umbrage" query "$file" --points "$folder/points" "$@" 2>"$folder/err" |
        awk '{ printf "%s%.5f", (NR == 1 ? "" : " "), $1 }'
}

scene glass 0.75
first=$(bake glass)
wanted="1.00000 0.60000 0.15000 0.25000 0.00000 1.00000"
same "light left is the product of what both panes let through" "$wanted" "$(answers "$folder/glass.umb")"
same "so it is for a window of 5 texels" "$wanted" "$(answers "$folder/glass.umb" --taps 5)"
"$BUILD/umbrage" unpack "$folder/glass.umb" -o "$folder/glass.umbm" >/dev/null 2>&1
same "the mapped form answers the same" "$wanted" "$(answers "$folder/glass.umbm")"
"$BUILD/umbrage" pack "$folder/glass.umbm" -o "$folder/again.umb" >/dev/null 2>&1
"$BUILD/umbrage" info "$folder/again.umb" --json >"$folder/info"
same "and packs to the same id" "$first" "$(json "$folder/info" "['asset']")"
same "4 threads, tiles of 64" "$first" "$(bake other --threads 4 --tile 64)"
"$BUILD/umbrage" verify "$folder/glass.umb" --scene "$folder/glass.obj" --points 20000 --json \
    >"$folder/verify" 2>"$folder/err"
same "the light that all casters leave equals rays" 0 $?
check "and points behind panes were among them" \
    test "$(json "$folder/verify" "['lights'][0]['translucent']")" -gt 1000
render() { # OPTION...: fields of the comparison
    "$BUILD/umbrage" render "$folder/${seen:-glass}.obj" --asset "$folder/${asset:-glass}.umb" \
        --compare --filter box --json --size 160x90 "$@" >"$folder/render" 2>"$folder/err" ||
        cat "$folder/err" >"$folder/render"
}
is_below() { # SENTENCE FIELD BOUND
    check "$1" test "$(awk 'BEGIN { print ('"$(json "$folder/render" "['$2']")"' < '"$3"') }')" = 1
}
render -o "$folder/glass.png"
is_below "so it does in a picture" mean_difference 0.005
check "in which the panes are seen" test "$(json "$folder/render" "['translucent']")" -gt 1000
# A pane that was changed must be found, in voxels and in the picture.
scene other 0.5
cp "$folder/glass.umb" "$folder/other.umb"
"$BUILD/umbrage" verify "$folder/other.umb" --scene "$folder/other.obj" --points 20000 --force \
    --quiet >"$folder/out" 2>"$folder/err"
same "the light of another pane is found wrong" 1 $?
seen=other asset=other render --force
check "and so it is in a picture" test "$(awk 'BEGIN { print ('"$(json "$folder/render" "['mean_difference']")"' > 0.02) }')" = 1
grep -q 'effect=transmittance state=on' "$folder/info" && ok "the plan says so" ||
    bad "the plan says so" "$(cat "$folder/info")"

mkdir "$folder/store"
cp "$folder/glass.umb" "$folder/store"
"$BUILD/umbraged" --store "$folder/store" --listen "unix:$folder/socket" >"$folder/log" 2>&1 &
children="$children $!"
export UMBRAGE_ADDRESS="unix:$folder/socket"
tries=0
until "$BUILD/umbrage" list >/dev/null 2>&1 || [ $tries -gt 300 ]; do
    tries=$((tries + 1))
    sleep 0.2
done
same "the daemon answers the same" "$wanted" "$(answers glass)"
same "of opaque casters alone, from the file" "1.00000 1.00000 1.00000 1.00000 0.00000 1.00000" \
    "$(answers "$folder/glass.umb" --opaque-only)"
same "and from the daemon" "1.00000 1.00000 1.00000 1.00000 0.00000 1.00000" \
    "$(answers glass --opaque-only)"

bake off --effect transmittance=off >/dev/null
same "off: panes are opaque" "1.00000 0.00000 0.00000 0.00000 0.00000 1.00000" \
    "$(answers "$folder/off.umb")"
"$BUILD/umbrage" info "$folder/off.umb" --json >"$folder/info"
asset=off render -o "$folder/off.png"
is_below "off: rays are stopped by panes" mean_difference 0.005
check "and cameras see through them" test "$(json "$folder/render" "['translucent']")" -gt 1000
"$BUILD/umbrage" info "$folder/off.umb" --json >"$folder/info"
same "off has no byte" 0 "$(json "$folder/info" "['transmittance_bytes']")"
scene solid 1
sed -i 's/^d .*//' "$folder/solid.mtl"
scene=solid
solid=$(bake solid)
same "opaque panes are voxels" "1.00000 0.00000 0.00000 0.00000 0.00000 1.00000" \
    "$(answers "$folder/solid.umb")"
same "of an asset that knows of no effect" "$solid" "$(bake solid --effect transmittance=off)"

# Nothing but glass.
scene all 0.75
sed -i 's/^newmtl ground/&\nd 0.5/' "$folder/all.mtl"
scene=all
bake all >/dev/null
same "a scene of glass alone" "1.00000 0.60000 0.15000 0.25000 0.50000 1.00000" \
    "$(answers "$folder/all.umb")"

finish
