#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The command line's contract: exit codes, one sentence for an error, outputs replaced whole or not
# at all, JSON that is JSON, data on stdout and talk on stderr.
. "$(dirname "$0")/../harness/umbrage_test.sh"
cd "$folder" || exit 1
for kind in city arch; do
    "$BUILD/scenegen" $kind --size 3 -o $kind.glb 2>/dev/null || exit 1
done
try 0 scenegen arch --size 3 --format glb -o -
check "scenegen -o - writes to stdout" cmp out arch.glb

# --- help and version of every program ---
version=$("$BUILD/umbrage" --version | cut -d' ' -f2)
for program in umbrage umbraged umbrage-bake umbrage-study; do
    try 0 $program --version
    same "  $program says name and version" "$program $version" "$(cat out)"
    try 0 $program --help
    check "  its help is on stdout" test -s out
    check "  and nothing on stderr" test ! -s err
    try 2 $program --no-such-option
    check "  a usage error is on stderr" test -s err
    check "  and nothing on stdout" test ! -s out
done
for command in info query sample list load submit watch jobs cancel fetch rm verify stream derive frames view \
    pack unpack; do
    try 0 umbrage $command --help
    check "  with a usage line" grep -q "umbrage $command" out
    try 0 umbrage help $command
    try 2 umbrage $command --no-such-option
done
for command in render verify; do
    try 0 umbrage-study $command --help
    try 0 umbrage-study $command -h
done
try 0 umbrage bake --help
try 0 umbraged -h
try 0 umbrage-study -h
try 0 umbrage render --help
try 2 umbrage
try 2 umbrage nothing
try 2 umbrage-bake
try 2 umbraged
try 2 umbrage-study
try 2 umbrage info
try 2 umbrage info a b c

# --- bake: what it says at its end ---
try 0 umbrage-bake city.glb -o kept.umb --resolution 256 --cache kept_tiles --verify 0
check "a bake says how fast it drew" grep -q '^rate .* Mtexel' out
try 0 umbrage-bake city.glb -o kept.umb --resolution 256 --cache kept_tiles --verify 0
check "  and names no rate when every tile was kept" sh -c '! grep -q ^rate out'

# --- bake: usage, missing, folder, bad data ---
try 2 umbrage-bake city.glb
one_sentence "-o"
for words in "--resolution 1000" "--resolution 32" "--sun 10" "--sun x,y" "--sun 10,95" \
    "--threads 0" "--threads x" "--memory 1" "--memory 4GB" "--tile 3" "--depth other" \
    "--closed maybe" "--up x" "--verify -1" "--light" "--sun 1,2 --light a"; do
    # shellcheck disable=SC2086
    try 2 umbrage-bake city.glb -o no.umb $words
    check "  nothing on stdout, something on stderr" test ! -s out -a -s err
done
try 66 umbrage-bake missing.glb -o no.umb
one_sentence "missing.glb"
mkdir a_folder
try 66 umbrage-bake a_folder -o no.umb
one_sentence "a_folder"
try 66 umbrage-bake a_folder/x.glb -o no.umb
one_sentence "x.glb"
printf 'solid nothing\nendsolid\n' >empty.stl
printf 'hello\n' >text.glb
printf 'ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n' >bad.ply
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\n' >points.obj
printf '' >nothing.obj
for file in empty.stl text.glb bad.ply points.obj nothing.obj; do
    try 65 umbrage-bake $file -o no.umb
    one_sentence $file
done
try 2 umbrage-bake city.glb -o no.umb --light nobody
one_sentence nobody
cp city.glb unknown.xyz
head -c 3000 city.glb >cut.glb
try 65 umbrage-bake cut.glb -o no.umb
one_sentence cut.glb
try 73 umbrage-bake city.glb -o no/such/folder/no.umb --resolution 64 --quiet
one_sentence no/such/folder
try 2 umbrage-bake city.glb -o city.glb --resolution 64
one_sentence city.glb
check "no failed bake leaves a file" test ! -e no.umb
same "no failed bake leaves a temporary" "" \
    "$(find . -name '*.tmp*' -o -name '*.part*' -o -name '.*umb*')"

# --- bake: what works ---
try 0 umbrage-bake city.glb -o city.umb --resolution 256 --quiet
check "--quiet says nothing" test ! -s out -a ! -s err
try 0 umbrage bake city.glb -o city.umb --resolution 256 --verify 0 -q
check "nor does -q" test ! -s out -a ! -s err
try 0 umbrage points city.glb -o few.f32 --count 10 -q
check "nor does umbrage-study's" test ! -s out -a ! -s err
try 0 umbrage-bake city.glb -o other.umb --resolution 256 --verify 0 --json
same "--json names the asset" "$("$BUILD/umbrage" info city.umb --quiet)" "$(json out "['asset']")"
try 0 umbrage bake arch.glb -o arch.umb --resolution 256 --verify 0 --quiet
try 0 umbrage-bake city.glb --plan
check "the plan names its effects" grep -q '^effect=closed state=on reason=' out
printf '0 1 0\n' >one.txt
for words in "" "--light-size 3" "--light-size 3deg"; do
    # shellcheck disable=SC2086
    try 0 umbrage query arch.umb --points one.txt --filter penumbra $words
    # shellcheck disable=SC2086
    try 0 umbrage render arch.glb --asset arch.umb -o arch.png --size 16x16 --filter penumbra $words -q
done
try 2 umbrage render arch.glb --asset arch.umb -o arch.png --filter penumbra --light-size 3m
try 0 umbrage-bake arch.glb --plan --json
check "the plan as JSON" json out "['plan'][0]"
check "an open scene says why it is not closed" \
    grep -q 'closed state=off reason=.*boundary edges' out
cp city.umb keep.umb
before=$(cksum keep.umb)
try 65 umbrage-bake bad.ply -o keep.umb
same "a failed bake leaves the old output alone" "$before" "$(cksum keep.umb)"

try 65 umbrage-bake arch.glb -o open.umb --resolution 256 --closed on --quiet
one_sentence "parts are not closed"

# --- an interrupted bake leaves nothing ---
"$BUILD/scenegen" terrain --size 300 -o big.ply 2>/dev/null
for number in INT TERM; do
    timeout --preserve-status -s $number -k 100 0.6 "$BUILD/umbrage-bake" big.ply -o big.umb \
        --resolution 262144 --verify 1000000000 --threads 1 >out 2>err # would take minutes
    code=$?
    case $code in
    75 | 130 | 143) ok "SIG$number ends a bake with exit code $code" ;;
    *) bad "SIG$number ends a bake" "exit code $code: $(tail -n 3 err)" ;;
    esac
    same "no output and no temporary after SIG$number" "" \
        "$(find . -name '*big.umb*' -o -name '*.tmp*' -o -name '*.part*')"
done

(ulimit -S -t 1 && ulimit -H -t 30 && exec "$BUILD/umbrage-bake" big.ply -o big.umb --resolution 262144 \
    --verify 1000000000 --threads 1) >out 2>err
same "a bake over its CPU time ends with 75" 75 $?
same "and leaves nothing" "" "$(find . -name '*big.umb*' -o -name '*.tmp*')"

# --- so do interrupted points; a place that cannot be written shows before the work ---
for number in TERM HUP; do
    echo old >big.pts
    "$BUILD/umbrage-study" points big.ply -o big.pts --count 1500000 --format text --quiet &
    points=$!
    while kill -0 $points 2>err && [ -z "$(find . -name '.tmp.big.pts*')" ]; do sleep 0.01; done
    kill -s $number $points
    wait $points 2>/dev/null # the shell's own "Hangup"
    same "SIG$number ends umbrage points" "$(kill -l $?)" $number
    same "no temporary after SIG$number" "old " "$(cat big.pts) $(find . -name '*.tmp*')"
done
try 2 umbrage points city.glb -o far.f32 --count 10 --origin 1e300,0,0
one_sentence "--origin: coordinates reach 1e+300 m"
try 0 umbrage points city.glb -o far.f64 --count 10 --origin 1e300,0,0 --format f64
try 73 umbrage-bake bad.ply -o missing/bad.umb
try 73 umbrage points bad.ply -o missing/bad.f32
try 0 umbrage points city.glb -o - --count 10
check "points to stdout are those of the file" cmp out few.f32
check "  and what is said of them is talk" test -s err -a ! -e -
try 0 umbrage points city.glb -o ./- --count 10 -q
check "  ./- is a file" cmp -- ./- few.f32
try 2 umbrage points city.glb -o - --count 10 --json
one_sentence "--json: does not go with --output -"
"$BUILD/umbrage" points city.glb -o - --count 10 -q >/dev/full 2>err
same "points to a full stdout end with 74" 74 $?

# --- pictures to stdout; a bake wants a name ---
rm ./-
set -- render city.glb --asset city.umb --size 16x9 --aa 1
try 0 umbrage "$@" -o city.png --compare --reference traced.png -q
try 0 umbrage "$@" -o - -q
check "a picture to stdout is that of the file" cmp out city.png
check "  --quiet says nothing" test ! -s err -a ! -e -
try 0 umbrage "$@" -o - --compare
check "  --compare, too" cmp out city.png
check "  and what is said of it is talk" grep -q "^asset against rays" err
try 0 umbrage "$@" --output=plain.png --compare --reference=- -q
check "--reference - is stdout" cmp out traced.png
try 0 umbrage "$@" -o ./- --compare -q
check "./- is a file" cmp -- ./- city.png
check "  and what is said of it is on stdout" grep -q "^asset against rays" out
rm ./-
for words in "-o - --json" "-o - --compare --reference -" "--compare --difference - --json"; do
    # shellcheck disable=SC2086
    try 2 umbrage "$@" $words
    one_sentence "have stdout"
done
"$BUILD/umbrage" "$@" -o - -q >/dev/full 2>err
same "a picture to a full stdout ends with 74" 74 $?
for words in "bake city.glb -o -" "bake city.glb --output=-" "bake tile city.glb -o -" \
    "bake import city.glb -o -" "study city.glb -o -" "fetch $(printf '%064d' 0) -o -"; do
    # shellcheck disable=SC2086
    try 2 umbrage $words
    one_sentence "./-"
    check "  nothing of that name" test ! -e - -a ! -e -.part
done
try 0 umbrage bake city.glb -o ./- --resolution 256 --verify 0 -q
try 0 umbrage verify ./-
rm ./-
try 73 umbrage render bad.ply --asset city.umb -o missing/bad.png
try 73 umbrage-bake bad.ply -o .

# --- info, verify, pack, unpack ---
try 66 umbrage info .
one_sentence "not a regular file"
echo text >notes.txt
try 65 umbrage submit notes.txt --address unix:none
one_sentence ".gltf .glb .obj .ply .stl"
try 0 umbrage info city.umb
check "info says the id" grep -qE '^asset +[0-9a-f]{64}$' out
try 0 umbrage info city.umb --json
same "info --json names the asset" "$("$BUILD/umbrage" info city.umb --quiet)" \
    "$(json out "['asset']")"
try 0 umbrage verify city.umb
try 0 umbrage verify city.umb --json
same "verify --json" True "$(json out "['good']")"
try 0 umbrage verify city.umb --scene city.glb --points 20000 --json
same "verify --scene --json" True "$(json out "['agrees']")"
same "  it names the asset" "$("$BUILD/umbrage" info city.umb --quiet)" "$(json out "['asset']")"
try 0 umbrage verify city.umb --scene city.glb --every-voxel --json
try 1 umbrage verify city.umb --scene arch.glb --every-voxel --force
try 2 umbrage verify city.umb --scene city.glb --every-voxel --points 5
try 65 umbrage verify city.umb --scene arch.glb --points 2000
try 1 umbrage verify city.umb --scene arch.glb --points 20000 --force
try 66 umbrage verify missing.umb
one_sentence missing.umb
try 66 umbrage verify city.umb --scene missing.glb
try 66 umbrage info a_folder/
long=$(printf '%0120d/%0120d/%0120d' 1 2 3)
mkdir -p "$long"
try 66 umbrage info "$long/missing.umb"
one_sentence "3/missing.umb: "
same "  that says where and why once" "umbrage: $long/missing.umb: No such file or directory" "$(cat err)"
try 66 umbrage info "$(printf 'two\001words.umb')"
same "  and control characters are blanks" "umbrage: two words.umb: No such file or directory" "$(cat err)"
size=$(wc -c <city.umb)
head -c $((size / 2)) city.umb >half.umb
cp city.umb flipped.umb
printf '\125' | dd of=flipped.umb bs=1 seek=$((size - 200)) conv=notrunc 2>/dev/null
printf 'not an asset, but long enough to be looked at as one, is it not?' >text.umb
: >empty.umb
cp text.umb e
try 65 umbrage verify e
one_sentence "umbrage: e: magic: "
for file in half.umb text.umb empty.umb; do
    for command in info verify; do
        try 65 umbrage $command $file
        one_sentence "umbrage: "
    done
    try 65 umbrage query $file --points /dev/null
done
try 65 umbrage verify flipped.umb
reason=$(cat err)
mv flipped.umb "$long"
try 65 umbrage verify "$long/flipped.umb"
one_sentence "3/${reason#umbrage: }"
try 0 umbrage unpack city.umb -o city.umbm
if valgrind -q "$BUILD/umbrage" --version >out 2>err; then # not with a sanitizer in it
    check "  and reads nothing that was not set" \
        valgrind -q --error-exitcode=1 "$BUILD/umbrage" unpack city.umb -o again.umbm
fi
try 0 umbrage pack city.umbm -o back.umb
check "pack of unpack is the same file" cmp city.umb back.umb
try 0 umbrage verify city.umbm
try 65 umbrage unpack half.umb -o keep.umb
same "a failed unpack leaves the old output alone" "$before" "$(cksum keep.umb)"
try 73 umbrage unpack city.umb -o no/such/folder/x.umbm

# --- query ---
printf '0 0 0\n10 5 10\n# a remark\n\n-20 1e1 3 0 1 0\n' >points
try 0 umbrage query city.umb --points points --quiet
same "three points, three answers" 3 "$(wc -l <out | tr -d ' ')"
check "--quiet says nothing" test ! -s err
try 0 umbrage query city.umb --points points
check "the summary is talk, not data" test "$(wc -l <out)" -eq 3 -a -s err
try 0 umbrage query city.umb --points points --quiet --output by_output
try 0 umbrage query city.umb --points points --quiet --output=by_out
check "  --output=FILE, too" cmp by_output by_out
try 2 umbrage query city.umb --points points --footprint 1e9
one_sentence "--footprint: 1e+09"
try 0 umbrage query city.umb --points points --json
same "query --json names the asset" "$("$BUILD/umbrage" info city.umb --quiet)" \
    "$(json out "['asset']")"
same "query --json has the answers" 3 "$(/usr/bin/python3 -c \
    'import json; print(len(json.load(open("out"))["answers"]))')"
try 0 umbrage query city.umb --points points --explain --json
check "query --explain --json is JSON" json out "['explanations']"
for line in '1 2' '1 2 3 4' 'a b c' '1 2 nan' '1 2 inf' '1,2,3' '1 2 3 4 5 6 7' '1 2 3x' \
    '1 2 1e999'; do
    printf '0 0 0\n1 1 1\n%s\n' "$line" >bad_points
    try 65 umbrage query city.umb --points bad_points -o answers.txt
    one_sentence bad_points:3
    check "  no output file" test ! -e answers.txt
done
seq 1 20 | sed 's/.*/0 50 0 0 -5 0/' >good_pairs
for words in --points --segments --boxes --columns '--explain --points'; do
    case $words in
    --seg* | --box*) cp good_pairs bad_later ;;
    *) seq 1 20 | sed 's/.*/0 50 0/' >bad_later ;;
    esac
    echo x >>bad_later
    # shellcheck disable=SC2086
    try 65 umbrage query arch.umb --batch 8 --json $words bad_later
    same "  what was answered before stands in JSON that is closed" 16 \
        "$(json out "[next(iter(data))].__len__()")"
    check "  without the asset, which stands behind the last answer" sh -c '! grep -q asset out'
done
head -c 121 /dev/zero >bytes
try 65 umbrage query city.umb --points bytes --format f32
head -c 240000 /dev/zero >bytes
try 0 umbrage query city.umb --points bytes --format f32 --encoding u8 --quiet -o answers.u8
same "20000 points, 20000 bytes" 20000 "$(wc -c <answers.u8 | tr -d ' ')"
head -c 2400000 /dev/zero >bytes
try 0 umbrage query city.umb --points bytes --format f32 --encoding f32 --quiet -o answers.f32
same "200000 points, 800000 bytes" 800000 "$(wc -c <answers.f32 | tr -d ' ')"
try 66 umbrage query city.umb --points missing
try 66 umbrage query missing.umb --points points
for words in "--taps 2" "--taps 19" "--taps x" "--format f16" "--encoding f16" "--bias much" \
    "--bias -1vox" "--light x" "--origin 1,2" "--batch 0" "--normals"; do
    # shellcheck disable=SC2086
    try 2 umbrage query city.umb --points points $words
done
try 2 umbrage query city.umb
try 66 umbrage query city.umb --points points --light 3
same "the message has the lights that are there" "umbrage: --light: 3, the asset's lights are 0 to 0" "$(cat err)"
try 0 umbrage query city.umb --points /dev/null --quiet
check "no points, no answers" test ! -s out
"$BUILD/umbrage" query city.umb --points bytes --format f32 --quiet >/dev/full 2>err
same "a full stdout is 74" 74 $?

# --- query: segments, columns, boxes, several lights ---
printf '0 50 0 0 -5 0\n-20 10 -3 20 10 -3\n1 1 1 1 1 1\n' >pairs
try 0 umbrage query city.umb --segments pairs
same "three segments, three lines" 3 "$(wc -l <out | tr -d ' ')"
try 0 umbrage query city.umb --segments pairs --json --quiet
check "segments have stretches" json out "['segments'][1]['stretches'][0][0]"
try 0 umbrage query city.umb --boxes pairs --json --quiet
same "a box of no volume has no voxel" 0 "$(json out "['boxes'][2]['voxels']")"
same "  and no share" None "$(json out "['boxes'][2]['share']")"
try 0 umbrage query arch.umb --columns points --quiet
same "three columns, three lines" 3 "$(wc -l <out | tr -d ' ')"
seq 1 200000 | sed 's/.*/0 0 0/' >many
try 0 umbrage query arch.umb --columns many --quiet
same "as many columns as points" 200000 "$(wc -l <out | tr -d ' ')"
try 69 umbrage query city.umb --columns points
one_sentence "--closed off"
try 65 umbrage query city.umb --segments points
one_sentence "points:1"
try 66 umbrage query city.umb --boxes pairs --light 1
try 0 umbrage query city.umb --points points --light 0,0 --quiet
same "two lights, two answers a line" 6 "$(wc -w <out | tr -d ' ')"
try 0 umbrage query city.umb --points points --light all --json --quiet
same "all lights of one are a list, too" "[0] 1" \
    "$(json out "['lights']") $(json out "['answers'][0].__len__()")"

# --- a daemon that is not there ---
for address in tcp:127.0.0.1:1 "unix:$folder/none.sock"; do
    for command in list "info city" "query city --points points"; do
        # shellcheck disable=SC2086
        try 69 umbrage $command --address "$address"
        one_sentence "$address"
    done
done
try 2 umbrage list --address nonsense
try 2 umbrage list --address tcp:127.0.0.1:99999
UMBRAGE_ADDRESS=unix:$folder/other.sock
export UMBRAGE_ADDRESS
try 69 umbrage list
one_sentence other.sock
unset UMBRAGE_ADDRESS

# --- a daemon that is there ---
# Waits for a file, a minute at most.
wait_file() {
    tries=0
    while [ ! -f "$1" ] && [ $tries -lt 240 ]; do
        tries=$((tries + 1))
        sleep 0.25
    done
}

# Starts a daemon of the store at the socket NAME.sock; the commands after it use that daemon.
start_daemon() { # NAME OPTION...
    socket=$folder/$1.sock addresses=$1.addresses
    shift
    "$BUILD/umbraged" --store store --listen "unix:$socket" --address-file "$addresses" --drain-delay 0 "$@" \
        >daemon.log 2>&1 &
    daemon=$!
    children="$children $daemon"
    wait_file "$addresses"
    UMBRAGE_ADDRESS=unix:$socket
    export UMBRAGE_ADDRESS
}

stop_daemon() { # its exit code
    kill -TERM $daemon
    wait $daemon
}

mkdir store
cp city.umb arch.umb store/
start_daemon d
try 0 umbrage list
same "list names both" "arch city " "$(grep -oE '\b(arch|city)\b' out | sort -u | tr '\n' ' ')"
try 0 umbrage list --json
check "list --json is JSON" json out "['assets'][0]['name']"
try 0 umbrage info city --json
same "info of a daemon's asset" "$("$BUILD/umbrage" info city.umb --quiet)" \
    "$(json out "['asset']")"
"$BUILD/umbrage" query city.umb --points points --taps 5 --quiet >file_answers
try 0 umbrage query city --points points --taps 5 --quiet
check "the daemon answers as the file does" cmp out file_answers
printf '\0\0\200\77\0\0\0\0\0\0\0\100' >lengths # 1, 0, 2
printf '\0\0\200\77\0\0\0\0\0\0\200\277' >below # 1, 0, -1
head -c 8 lengths >short
cat lengths short >long
for asset in city.umb city; do
    try 0 umbrage query $asset --points points --filter footprint --footprints lengths --quiet
    try 65 umbrage query $asset --points points --filter footprint --footprints below
    one_sentence "below: footprint 2 is -1"
    try 65 umbrage query $asset --points points --filter footprint --footprints short
    one_sentence "short: ends after 2"
    try 65 umbrage query $asset --points points --filter footprint --footprints long -o none
    one_sentence "long: goes on after"
    check "  no output file" test ! -e none
done
for dial in "--max-error 30" "--max-error 0.3vis" "--level 3"; do
    # shellcheck disable=SC2086
    "$BUILD/umbrage" query city.umb --points points $dial --json --quiet >file_answers
    # shellcheck disable=SC2086
    try 0 umbrage query city --points points $dial --json --quiet
    for key in answers level taps bound_m visibility_error lines_per_point; do
        same "  $dial: $key of the daemon" "$(json file_answers "['$key']")" "$(json out "['$key']")"
    done
done
try 2 umbrage query city --points points --max-error 0.0001
one_sentence "--max-error: 0.0001 m: this light's asset reaches"
try 2 umbrage query city --points points --max-error 0.0001vis
one_sentence "--max-error: visibility 0.0001: this light's asset reaches"
try 66 umbrage query nobody --points points
one_sentence nobody
try 66 umbrage info nobody
printf '0 0 0\n1 2\n' >bad_points
try 65 umbrage query city --points bad_points
one_sentence bad_points:2
try 0 umbrage render city.glb --asset city -o daemon.png --size 64x48 --quiet
try 0 umbrage render city.glb --asset city.umb -o file.png --size 64x48 --quiet
try 0 umbrage render city.glb --asset city.umb -o wide.png --size 64x48 --camera fov=62.5
view=$(sed -n 's/^camera //p' out)
same "render prints the camera's field of view" fov=62.5 "$(echo "$view" | grep -o 'fov.*')"
try 0 umbrage render city.glb --asset city.umb -o again.png --size 64x48 --camera "$view"
same "  and takes what it printed" "$view" "$(sed -n 's/^camera //p' out)"
check "render by daemon and by file are one picture" cmp daemon.png file.png
stop_daemon
same "the daemon exits with 0" 0 $?

# --- a daemon that takes little at once ---
start_daemon l --max-points 30
try 0 umbrage points city.glb --normals --count 200 -o some.f32
for words in "" "--batch 7" "--encoding bit" "--encoding u8 --batch 8"; do
    for target in city.umb city; do
        # shellcheck disable=SC2086
        try 0 umbrage query $target --points some.f32 --format f32 --normals --taps 3 $words \
            --output $target.answers --quiet
    done
    check "  the same in calls of 30 points at most" cmp city.answers city.umb.answers
done
try 0 umbrage query city --points some.f32 --format f32 --normals --budget 100000 --quiet
try 69 umbrage query city --boxes pairs
one_sentence "takes no boxes: max_boxes is 0 (max_points is 30)"
try 69 umbrage query city --segments pairs --json
one_sentence "takes no segments: max_segments is 0"
try 0 umbrage render city.glb --asset city -o little.png --size 64x48 --quiet
check "render in calls of 30 points is the same picture" cmp little.png file.png
stop_daemon

# --- calls whose bits are no whole bytes ---
start_daemon b --max-points 3
set -- --points some.f32 --format f32 --normals --taps 3 --encoding bit --quiet
try 0 umbrage query city.umb "$@" --output city.umb.answers
try 0 umbrage query city.umb "$@" --output by_13.answers --batch 13
check "bits in batches of 13 points are the same" cmp by_13.answers city.umb.answers
try 0 umbrage query city "$@" --output city.answers
check "  and in calls of 3" cmp city.answers city.umb.answers
stop_daemon

# --- a daemon that asks for a token ---
token=0123456789abcdef0123456789
(umask 077 && echo "studio query $token" >tokens)
echo $token >token
start_daemon t --token-file tokens
set -- umbrage render city.glb --asset city -o token.png --size 64x48 --quiet
try 77 "$@"
one_sentence TOKEN
try 0 "$@" --token-file token
check "render shows a token from a file" cmp token.png file.png
try 66 "$@" --token-file no_token
one_sentence no_token
try 2 "$@" --tls-ca token
one_sentence tls:
export UMBRAGE_TOKEN=$token
try 0 "$@"
unset UMBRAGE_TOKEN
stop_daemon
try 0 umbrage version --json
same "  the version as an object" "{\"program\":\"umbrage\",\"version\":\"$version\"}" "$(cat out)"
try 2 umbrage version 2
try 0 umbraged --store store --check-config
try 2 umbraged --store store --listen nonsense --check-config
try 0 umbraged --store missing --check-config
try 0 umbraged --store store --check
try 66 umbraged --store missing --check
one_sentence missing
try 66 umbraged --store store --token-file missing --check
try 0 umbraged --store store --jobs not-yet --check
check "  makes nothing" test ! -e not-yet
try 73 umbraged --store store --jobs no/such --check
one_sentence no/such
try 73 umbraged --store store --jobs city.umb --check
try 2 umbraged --store store --jobs store --check
try 69 umbraged --store store --jobs not-yet --bake-program missing --check
env PATH="$folder" "$BUILD/umbraged" --store store --jobs not-yet --executor slurm --check >out 2>err
same "umbraged --check misses Slurm's commands" 69 $?
one_sentence sbatch
try 2 umbraged --store store --jobs store --listen "unix:$folder/f.sock"
check "  and leaves nothing in the store" test ! -e store/assets
try 2 umbraged --store store --workers 0 --check-config
try 66 umbraged --store missing --listen "unix:$folder/e.sock"
try 69 umbraged --store store --listen "unix:$folder/no/such/e.sock"
check "  the folder is missing, not the right" grep -q "e.sock': no such file or directory" err
try 66 umbrage render missing.glb --asset city.umb -o x.png
try 66 umbrage render city.glb --asset missing.umb -o x.png
try 2 umbrage render city.glb --asset city.umb
try 73 umbrage render city.glb --asset city.umb -o no/such/x.png --size 32x32
check "no picture after a failure" test ! -e x.png
finish
