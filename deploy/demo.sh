#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The demonstration: bake scenes, serve them, query a million surface points over gRPC from another
# process, verify against rays, draw pictures, and print the times and sizes. At its end it stops
# the processes that it started.
#
#   BUILD=build/release   where the programs are
#   OUT=demo-out          where pictures and assets go
#   UMBRAGE_SCENES=DIR    real scenes, used where they exist (default ../shared/scenes)
set -eu
cd "$(dirname "$0")/.."
BUILD=${BUILD:-build/release}
OUT=${OUT:-demo-out}
SCENES=${UMBRAGE_SCENES:-../shared/scenes}
POINTS=${POINTS:-1000000}
daemon=
begin=$(date +%s)

stop() {
    code=$?
    if [ -n "$daemon" ] && kill -0 "$daemon" 2>/dev/null; then
        kill -TERM "$daemon" 2>/dev/null || true
        wait "$daemon" || true
    fi
    rm -rf "$work"
    exit $code
}
work=$(mktemp -d)
trap stop EXIT
trap 'exit 130' INT TERM
mkdir -p "$OUT" "$work/store"

number() { # FILE KEY: a number of a one-object JSON file
    sed -n "s/.*\"$2\": *\([-0-9.eE+]*\).*/\1/p" "$1" | head -n 1
}

say() {
    printf '\n== %s\n' "$*" >&2
}

# bake NAME SCENE RESOLUTION OPTIONS...
bake() {
    name=$1 scene=$2 resolution=$3
    shift 3
    say "baking $name at $resolution"
    "$BUILD/umbrage-bake" "$scene" -o "$work/store/$name.umb" --resolution "$resolution" \
        --json "$@" >"$work/$name.bake"
    printf '%s %s\n' "$name" "$scene" >>"$work/scenes"
}

"$BUILD/scenegen" city --size 50 --seed 1 --format glb -o "$OUT/city.glb"
bake city "$OUT/city.glb" 16384 --sun 135,40
if [ -d "$SCENES" ]; then
    bake garden "$SCENES/garden_sterngarten/sterngarten_mask.glb" 8192 --sun 135,40
    bake delft "$SCENES/city_delft/delft_all.obj" 16384 --sun 135,40
fi

say "starting umbraged"
"$BUILD/umbraged" --store "$work/store" --listen tcp:127.0.0.1:0 --listen "unix:$work/socket" \
    --address-file "$work/address" --drain-delay 0ms --log-level warn &
daemon=$!
for _ in $(seq 100); do
    [ -s "$work/address" ] && break
    kill -0 "$daemon"
    sleep 0.1
done
UMBRAGE_ADDRESS=$(grep '^tcp:' "$work/address")
export UMBRAGE_ADDRESS
for _ in $(seq 300); do # ready once every asset is loaded
    [ "$("$BUILD/umbrage" list --quiet | wc -l)" -ge "$(wc -l <"$work/scenes")" ] && break
    sleep 0.1
done

# rate FILE: points a second of a query's JSON
rate() {
    awk -v points="$POINTS" -v seconds="$(number "$1" seconds)" 'BEGIN { printf "%.2f", points / seconds / 1e6 }'
}

while read -r name scene; do
    say "asking for $POINTS surface points of $name, verifying, drawing"
    "$BUILD/umbrage" points "$scene" --count "$POINTS" --normals --format f32 -o "$work/points" --quiet
    "$BUILD/umbrage" query "$work/store/$name.umb" --points "$work/points" --format f32 --normals --taps 9 \
        --encoding u8 --output "$work/file.u8" --json --quiet >"$work/$name.file"
    "$BUILD/umbrage" query "$name" --points "$work/points" --format f32 --normals --taps 9 \
        --encoding u8 --output "$work/grpc.u8" --json --quiet >"$work/$name.grpc"
    cmp "$work/file.u8" "$work/grpc.u8" # the same bits from file and service
    "$BUILD/umbrage" verify "$work/store/$name.umb" --scene "$scene" --points 200000 --json >"$work/$name.verify"
    "$BUILD/umbrage" render "$scene" --asset "$name" -o "$OUT/$name.png" --quiet
    if [ "$name" = city ]; then
        "$BUILD/umbrage" render "$scene" --asset "$name" -o "$OUT/city-street.png" --quiet \
            --camera eye=-170,60,190,target=0,5,0,fov=50
    fi
done <"$work/scenes"
cp "$work/store/"*.umb "$OUT/"

printf '\n%-8s %10s %7s %7s %10s %7s %11s %11s %12s %9s\n' scene triangles size bake_s bytes of_SM16 \
    file_Mpts/s gRPC_Mpts/s in_band_% outside
while read -r name scene; do
    b=$work/$name.bake v=$work/$name.verify
    printf '%-8s %10s %7s %7.1f %10s %6.2f%% %11s %11s %12.2f %9s\n' "$name" "$(number "$b" triangles)" \
        "$(number "$b" resolution)" "$(number "$b" total)" "$(number "$b" bytes)" \
        "$(awk -v s="$(number "$b" share_of_shadow_map)" 'BEGIN { print 100 * s }')" \
        "$(rate "$work/$name.file")" "$(rate "$work/$name.grpc")" \
        "$(awk -v s="$(number "$v" inside_rate)" 'BEGIN { print 100 * s }')" "$(number "$v" outside_band)"
done <"$work/scenes"
cat <<EOF

of_SM16: of a 16-bit shadow map of the same size. Points: 9x9 PCF on one thread from the file, over gRPC from
another process. in_band: points near shadow boundaries that differ from rays within one voxel; outside: beyond it.
Pictures and assets are in $OUT. $(($(date +%s) - begin)) seconds.
In the browser: make view
EOF
