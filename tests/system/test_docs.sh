#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What docs/reference/operations.md and docs/reference/protocol.md say about options and metrics is
# what umbraged has, and the other way round: names, defaults, kinds of abuse.
. "$(dirname "$0")/../harness/umbrage_test.sh"
operations=$root/docs/reference/operations.md
protocol=$root/docs/reference/protocol.md

# names PATTERN FILE...: every match in the files, sorted, once each.
names() {
    pattern=$1
    shift
    grep -ohE -- "$pattern" "$@" | sort -u
}

# all_in SENTENCE LIST FILE: each line of LIST is a line of FILE.
all_in() {
    missing=$(comm -23 "$2" "$3" | tr '\n' ' ')
    same "$1" "" "$missing"
}

# Every RPC of our .proto files has its path in the table, and no other is there.
for file in "$root"/proto/umbrage/v1/*.proto "$root"/proto/grpc/*/v1/*.proto; do
    awk '/^package/ { package = $2; sub(/;/, "", package) }
        /^service/ { service = $2 }
        /^  rpc/ { name = $2; sub(/\(.*/, "", name); print "/" package "." service "/" name }' "$file"
done | sort -u >"$folder/rpcs"
[ "$(wc -l <"$folder/rpcs")" -gt 6 ] || bad "the .proto files have RPCs" "$(cat "$folder/rpcs")"
grep '^| `/' "$protocol" | cut -d'|' -f2 | grep -oE '/[A-Za-z0-9_./]+' | grep -v v1alpha | sort -u >"$folder/rpcs.told"
all_in "every RPC is in docs/reference/protocol.md" "$folder/rpcs" "$folder/rpcs.told"
all_in "every RPC in docs/reference/protocol.md exists" "$folder/rpcs.told" "$folder/rpcs"

same "the files in docs/explained/ways.md are those of the build" "" "$(/usr/bin/python3 "$root/tests/lint/ways.py" 2>&1)"

try 0 umbraged --print-options
cp "$folder/out" "$folder/rows"
cut -f 2 "$folder/rows" | sort -u >"$folder/options"
[ "$(wc -l <"$folder/options")" -gt 15 ] || bad "umbraged lists its options" "$(cat "$folder/options")"

# A line of usage must not name an option of another program. Options of umbrage-bake, umbrage,
# podman and skopeo are recognised by their program on the line; podman's commands take several
# lines.
sed -E -e ':a' -e '/^podman.*\\$/{N;s/\\\n//;ba' -e '}' -e 's/(umbrage(-bake)?|podman|skopeo) [^`]*//g' "$operations" "$protocol" >"$folder/docs"
names '--[a-z][a-z-]+' "$folder/docs" >"$folder/told"
all_in "every option of umbraged is in operations.md or protocol.md" "$folder/options" "$folder/told"
"$BUILD/umbrage-bake" --help | grep -oE -- '--[a-z][a-z-]+' | sort -u - "$folder/options" >"$folder/known"
all_in "every option in the two pages is in --help, there or of umbrage-bake" "$folder/told" "$folder/known"
names '^\| `--[a-z-]+[^|]*' "$operations" | grep -oE -- '--[a-z-]+' | sort -u >"$folder/table"
printf '%s\n' --check --check-config --help --print-config --version | sort >"$folder/flags"
sort -u "$folder/table" "$folder/flags" >"$folder/listed"
all_in "every option has a row in the table of operations.md" "$folder/options" "$folder/listed"

# The options that a job may have (client/tool/bake_settings.c) must be in
# docs/reference/protocol.md, and umbrage-bake must have them.
"$BUILD/umbrage" submit --help | sed -n '/^bake options:/,/^the daemon:/p' | grep -oE '^  --[a-z-]+' | sed 's/ *--//' | sort -u >"$folder/bake.options"
[ "$(wc -l <"$folder/bake.options")" -gt 10 ] || bad "jobs take bake options" "$(cat "$folder/bake.options")"
"$BUILD/umbrage-bake" --print-options | cut -f 2 | sed 's/^--//' | sort -u >"$folder/all.options"
all_in "umbrage-bake has every bake option that a job takes" "$folder/bake.options" "$folder/all.options"
names '`[a-z-]+`' "$protocol" | tr -d '`' | sort -u >"$folder/protocol.words"
all_in "docs/reference/protocol.md names them, too" "$folder/bake.options" "$folder/protocol.words"

# A table is a header, a line of dashes and rows, each one line long; else a page shows bars.
find "$root/docs" "$root/README.md" -name '*.md' | sort | while read -r page; do
    awk -v page="${page#"$root"/}" '
        /^```/ { code = !code }
        !code && /^\|/ {
            if (!/\|$/) print page ":" FNR ": a row does not end with a bar"
            if (++rows == 2 && !/^[|: -]+$/) print page ":" FNR ": no line of dashes below a header"
        }
        !/^\|/ { if (rows == 1) print page ":" FNR - 1 ": a row without a table"; rows = 0 }' "$page"
done >"$folder/tables"
same "tables hold together" "" "$(cat "$folder/tables")"

# Links and anchors of pages lead somewhere, pages named in sources exist, lines and pages are short.
/usr/bin/python3 "$root/tests/harness/page_checks.py" "$root" >"$folder/pages" 2>&1
same "links lead somewhere; lines and pages are short" "" "$(cat "$folder/pages")"

# The API index has every public function.
same "the API index is that of the headers" "" "$(/usr/bin/python3 "$root/tests/harness/api_index.py")"

# Each picture must have its commands in docs/pictures/README.md, and programs must accept them:
# with the scenes missing they fail because of that (66), not because of their options (2). Commands
# that make scenes run, and the scenes are removed again, so that no bake begins.
/usr/bin/python3 - "$root" "$folder" "$BUILD" >"$folder/pictures" 2>&1 <<'EOF'
import os
import pathlib
import re
import subprocess
import sys

root, folder, build = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]).resolve()
page = (root / "docs/pictures/README.md").read_text(encoding="utf-8")
blocks = re.findall(r"^## ([^\n]+)\n\n```sh\n(.*?)^```", page, re.M | re.S)
told = sorted(name for heading, _ in blocks for name in heading.split(", "))
found = sorted(path.name for path in (root / "docs/pictures").glob("*.png"))
elsewhere = re.findall(r"`([a-z-]+\.png)`", page)  # with the page that has them under test
for name in sorted(set(told + elsewhere) ^ set(found)):
    print(f"{name}: {'no commands' if name in found else 'no such picture'}")
WRAP = """
run() { "$@" >run.out 2>run.err </dev/null; code=$?; echo run >>runs
    [ $code -eq 66 ] || { echo "exit code $code: $*"; cat run.err; }; }
make() { "$@" >run.out 2>run.err </dev/null || { echo "exit code $?: $*"; cat run.err; }; rm -f ./*.glb ./*.obj; }
umbrage() { run "$BUILD/umbrage" "$@"; }
study() { run "$BUILD/umbrage-study" "$@"; }
scenegen() { make "$BUILD/scenegen" "$@"; }
scenes() { make "$ROOT/tests/harness/translucent_scenes.py" "$@"; }
picture_sheet() { [ $# -gt 2 ]; }
failure_pictures() { [ $# -eq 1 ]; }
view_pictures() { [ $# -eq 5 ]; }
paging() { "$ROOT/tests/bench/paging_figures.py" --help >run.out 2>&1 || { echo "exit code $?"; cat run.out; }; }
"""
for heading, block in blocks:
    place = folder / "pictures.run" / heading.split(",")[0]
    place.mkdir(parents=True)
    for name, wrapped in (("umbrage-study", "study"), ("translucent_scenes.py", "scenes"),
                          ("tests/bench/paging_figures.py", "paging"), ("view_pictures.py", "view_pictures")):
        block = re.sub(rf"^{re.escape(name)} ", wrapped + " ", block, flags=re.M)
    done = subprocess.run(["sh", "-c", WRAP + block], cwd=place, text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, check=False,
                          env={**os.environ, "BUILD": str(build), "ROOT": str(root), "UMBRAGE_SCENES": "no"})
    for line in done.stdout.splitlines():
        print(f"{heading}: {line}")
    if re.search("^umbrage|^study", block, re.M) and not (place / "runs").exists():
        print(f"{heading}: no command was tried")
if len(blocks) < 10:
    print(f"only {len(blocks)} blocks of commands")
EOF
same "each picture has commands, and they are understood" "" "$(cat "$folder/pictures")"

# Defaults: the page writes "64 MiB", the program "64MiB"; a row of the page may have several options.
/usr/bin/python3 - "$folder/rows" "$operations" >"$folder/defaults" 2>&1 <<'EOF'
import re
import sys

with open(sys.argv[1], encoding="utf-8") as file:
    found = [(row[1], row[6]) for row in (line.rstrip("\n").split("\t") for line in file) if row[6]]
with open(sys.argv[2], encoding="utf-8") as file:
    rows = [[cell.strip() for cell in line.strip("|\n").split("|")]
            for line in file if line.startswith("| `--")]
table = {}
for row in rows:
    options = re.findall(r"--[a-z-]+", row[0])
    values = re.split(r", ", row[1])
    for i, option in enumerate(options):
        table[option] = values[min(i, len(values) - 1)].replace("`", "").strip().replace(" min", "m")
assert len(found) > 10, found
for option, value in found:
    told = table.get(option, "nothing")
    if told.replace(" ", "") != value.replace(" ", ""):
        print(f"{option}: the program says {value}, the page {told}")
EOF
same "the defaults in operations.md are those of umbraged" "" "$(cat "$folder/defaults")"

mkdir "$folder/store"
"$BUILD/umbraged" --store "$folder/store" --jobs "$folder/jobs" --listen "unix:$folder/socket" --admin 127.0.0.1:0 \
    --address-file "$folder/addresses" --drain-delay 0 2>"$folder/log" &
children=$!
waited=0
while [ ! -s "$folder/addresses" ] && [ $waited -lt 100 ]; do
    sleep 0.1
    waited=$((waited + 1))
done
admin=$(sed -n 's/^http://p' "$folder/addresses")
/usr/bin/python3 -c '
import sys, urllib.request
print(urllib.request.urlopen(sys.argv[1], timeout=10).read().decode())' "http://$admin/metrics" \
    >"$folder/metrics"
kill -TERM $children
wait $children
same "the daemon exits with 0" 0 $?
sed -n 's/^# TYPE \([a-z0-9_]*\) .*/\1/p' "$folder/metrics" | sort -u >"$folder/served"
[ "$(wc -l <"$folder/served")" -gt 15 ] || bad "metrics are served" "$(head -n 5 "$folder/metrics")"
names '`(umbrage|grpc|process)_[a-z0-9_]+' "$operations" "$protocol" | tr -d '`' | sort -u >"$folder/written"
all_in "every metric served is in docs/reference/operations.md" "$folder/served" "$folder/written"
all_in "every metric in the pages is served" "$folder/written" "$folder/served"
sed -n 's|^grpc_server_started_total{grpc_service="\([^"]*\)",grpc_method="\([^"]*\)".*|/\1/\2|p' "$folder/metrics" | sort -u >"$folder/labels"
all_in "every RPC has its labels in the metrics" "$folder/rpcs" "$folder/labels"
sed -n 's/.*h2_abuse_total{kind="\([a-z_]*\)".*/\1/p' "$folder/metrics" | sort -u >"$folder/kinds"
grep -F 'umbrage_h2_abuse_total{kind}' "$operations" | grep -oE '`[a-z_]+`' | tr -d '`' | sort -u >"$folder/kinds.told"
all_in "every kind of abuse is explained" "$folder/kinds" "$folder/kinds.told"
all_in "every kind of abuse explained exists" "$folder/kinds.told" "$folder/kinds"
finish
