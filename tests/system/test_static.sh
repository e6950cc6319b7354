#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The effect `static`: points on surfaces must get the same answers as without it, and points in the
# air must be counted as undefined, by files and by the service. Ids must be equal for all tiles,
# threads and depth paths.
. "$(dirname "$0")/../harness/umbrage_test.sh"

bake() { # OUT OPTION...
    out=$1
    shift
    "$BUILD/umbrage-bake" "$scene" -o "$folder/$out.umb" --json --quiet --sun 140,30 --verify 50000 \
        --resolution 1024 "$@" >"$folder/json" 2>"$folder/err" || cat "$folder/err" >"$folder/json"
    json "$folder/json" "['asset']"
}

query() { # ASSET POINTS OPTION...
    asset=$1 points=$2
    shift 2
    "$BUILD/umbrage" query "$asset" --points "$folder/$points" "$@" 2>"$folder/said"
}

undefined() { # ASSET POINTS OPTION...
    query "$@" --json >"$folder/answers.json"
    json "$folder/answers.json" "['stats']['undefined']"
}

scene=$folder/arch.ply
"$BUILD/scenegen" arch --size 8 -o "$scene" 2>/dev/null
# Points of triangles, at random, with normals that face the light; then some far from all of them.
/usr/bin/python3 - "$scene" "$folder/surface" "$folder/air" <<'PY'
import random, sys
random.seed(5)
text = open(sys.argv[1], 'rb').read()
head, body = text.split(b'end_header\n', 1)
words = head.decode().split()
count = {words[i + 1]: int(words[i + 2]) for i, w in enumerate(words) if w == 'element'}
import struct
assert 'binary_little_endian' in words, words
kind, size = ('d', 8) if 'double' in words else ('f', 4)
step = 3 * size
vertices = [struct.unpack_from('<3' + kind, body, i * step) for i in range(count['vertex'])]
at, faces = count['vertex'] * step, []
for _ in range(count['face']):
    faces.append(struct.unpack_from('<3i', body, at + 1))
    at += 13
sun = (-0.5567, 0.6634, -0.5)  # the way of light from 140, 30
with open(sys.argv[2], 'w') as surface:
    while surface.tell() < 200000:
        a, b, c = (vertices[i] for i in random.choice(faces))
        u, v = random.random(), random.random()
        u, v = (1 - u, 1 - v) if u + v > 1 else (u, v)
        p = [a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]) for k in range(3)]
        e, f = [b[k] - a[k] for k in range(3)], [c[k] - a[k] for k in range(3)]
        n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]]
        length = sum(x * x for x in n) ** 0.5
        if length > 0:
            turn = -1 if sum(x * y for x, y in zip(n, sun)) > 0 else 1
            print(*p, *(turn * x / length for x in n), file=surface)
low, high = ([f(p[k] for p in vertices) for k in range(3)] for f in (min, max))
with open(sys.argv[3], 'w') as air:
    for _ in range(500):
        print(*(low[k] + random.random() * (high[k] - low[k]) for k in range(3)), file=air)
PY
count=$(wc -l <"$folder/surface")

bake open --closed off >/dev/null
first=$(bake static --closed off --static)
same "the effect has its name" "$first" "$(bake other --closed off --effect static=on)"
same "tiles of 64, 3 threads" "$first" "$(bake other --closed off --static --tile 64 --threads 3)"
same "depth by Embree" "$first" "$(bake other --closed off --static --depth embree --tile 256)"
same "nothing is kept, nothing is found" "$first" \
    "$(bake other --closed off --static --cache "$folder/cache")"
"$BUILD/umbrage-bake" "$scene" --plan --static 2>/dev/null >"$folder/plan"
check "the plan says so" grep -q 'effect=static state=on' "$folder/plan"
"$BUILD/umbrage" info "$folder/open.umb" --json >"$folder/none"
"$BUILD/umbrage" info "$folder/static.umb" --json >"$folder/info"
same "off has no byte" 0 "$(json "$folder/none" "['near_bytes']")"
same "on has 32 KiB a light" 32768 "$(json "$folder/info" "['near_bytes']")"
try 0 umbrage verify "$folder/static.umb" --scene "$scene" --points 50000
check "surfaces are not called boundaries" sh -c "! grep -q 'near a boundary' $folder/out"

for taps in 1 9 17; do
    query "$folder/open.umb" surface --taps $taps >"$folder/open.txt"
    query "$folder/static.umb" surface --taps $taps >"$folder/static.txt"
    same "$taps taps: nothing on a surface gets darker, of $count points" "$count" \
        "$(paste "$folder/open.txt" "$folder/static.txt" | awk '$2 >= $1' | wc -l)"
    # A triangle whose texels are all lit at their centres may still have a shadow's edge within a
    # voxel.
    lost=$(paste "$folder/open.txt" "$folder/static.txt" | awk '$1 == 0 && $2 > 0.5' | wc -l)
    check "$taps taps: no shadow is lost but within a voxel of its edge ($lost)" test "$lost" -le 10
    same "$taps taps: no point of a surface is undefined" 0 \
        "$(undefined "$folder/static.umb" surface --taps $taps)"
done
same "without the rule nothing is undefined" 0 "$(undefined "$folder/open.umb" air)"
air=$(undefined "$folder/static.umb" air)
check "points in the air are undefined ($air of 500)" test "$air" -gt 50
check "a person is told how many" grep -q "points undefined" "$folder/said"

try 69 umbrage query "$folder/static.umb" --points "$folder/air" --level 3
try 69 umbrage query "$folder/static.umb" --columns "$folder/air"
try 2 umbrage-bake "$scene" -o "$folder/x.umb" --static --effect front=on
try 65 umbrage-bake "$scene" -o "$folder/x.umb" --static --point 0,0,3 --resolution 256
try 2 umbrage-bake tile "$scene" -o "$folder/tiles" --static

mkdir "$folder/store"
cp "$folder/static.umb" "$folder/store"
"$BUILD/umbraged" --store "$folder/store" --listen "unix:$folder/socket" >"$folder/log" 2>&1 &
children=$!
tries=0
until "$BUILD/umbrage" list --address "unix:$folder/socket" 2>/dev/null | grep -q static ||
    [ $tries -gt 600 ]; do
    tries=$((tries + 1))
    sleep 0.1
done
UMBRAGE_ADDRESS=unix:$folder/socket
export UMBRAGE_ADDRESS
same "the service counts the same" "$air" "$(undefined static air)"
query "$folder/static.umb" surface --taps 9 >"$folder/file.txt"
query static surface --taps 9 >"$folder/served.txt"
same "and answers the same" "$(cksum <"$folder/file.txt")" "$(cksum <"$folder/served.txt")"
finish
