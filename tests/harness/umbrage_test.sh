# SPDX-License-Identifier: Apache-2.0
# Shared by the tests in shell: sourced, not run. Sets $folder (temporary, removed at the end) and
# gives checks that are counted. BUILD names the build folder (default build/release).
set -u
root=$(cd "$(dirname "$0")/../.." && pwd)
case ${BUILD:=build/release} in
/*) ;;
*) BUILD=$root/$BUILD ;;
esac
folder=$(mktemp -d) || exit 1
children=
passed=0 failed=0
cleanup() {
    for child in $children; do
        kill -KILL "$child" 2>/dev/null
    done
    rm -rf "$folder"
}
trap cleanup EXIT
trap 'exit 1' INT TERM HUP

ok() { # SENTENCE...
    passed=$((passed + 1))
    echo "ok $*"
}

bad() { # SENTENCE DETAIL
    failed=$((failed + 1))
    echo "FAILED $1: ${2-}"
}

# check SENTENCE COMMAND...: the command must succeed.
check() {
    sentence=$1
    shift
    if "$@" >"$folder/.check" 2>&1; then
        ok "$sentence"
    else
        bad "$sentence" "$* $(tail -n 5 "$folder/.check")"
    fi
}

# left_out NAME REASON: a part that does not run here; run.sh counts and lists it as skipped.
left_out() {
    echo "SKIPPED: $1: $2"
}

# same SENTENCE WANTED GOT
same() {
    if [ "$2" = "$3" ]; then
        ok "$1"
    else
        bad "$1" "'$3' is not '$2'"
    fi
}

# try CODE PROGRAM ARGUMENT...: runs a program of the build, output in $folder/out and $folder/err,
# and demands the exit code. One that hangs is ended after $limit seconds.
limit=120
try() {
    wanted=$1
    program=$2
    shift 2
    timeout "$limit" "$BUILD/$program" "$@" >"$folder/out" 2>"$folder/err" </dev/null
    code=$?
    if [ $code -eq "$wanted" ]; then
        ok "$program $* exits with $wanted"
    else
        bad "$program $* exits with $wanted" "exit code $code: $(tail -n 3 "$folder/err")"
    fi
}

# The last program's stderr is one sentence, on one line, and its stdout is empty.
one_sentence() { # WORD that it must hold
    lines=$(wc -l <"$folder/err")
    if [ "$lines" -eq 1 ] && grep -qF -- "$1" "$folder/err" && [ ! -s "$folder/out" ]; then
        ok "  one sentence that names '$1'"
    else
        bad "  one sentence that names '$1'" "$(cat "$folder/err" "$folder/out" | head -n 5)"
    fi
}

# json FILE EXPRESSION: prints a value of a JSON object, for example "['asset']".
json() {
    /usr/bin/python3 -c '
import json, sys
with open(sys.argv[1], encoding="utf-8") as file:
    data = json.load(file)
print(eval("data" + sys.argv[2]))' "$1" "$2"
}

finish() {
    echo "$passed checks passed, $failed failed"
    [ "$failed" -eq 0 ]
    exit
}
