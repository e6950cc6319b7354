#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Rules that no compiler checks: banned functions, SPDX lines, file names, long functions, leftovers.
set -eu
cd "$(dirname "$0")/../.."
failures=0

report() { # WHAT OUTPUT
    if [ -n "$2" ]; then
        echo "lint: $1"
        echo "$2" | sed 's/^/  /'
        failures=$((failures + 1))
    fi
}

sources=$(git ls-files '*.c' '*.h')

report "banned function" "$(echo "$sources" | xargs grep -nE '(^|[^a-zA-Z0-9_])(strcpy|strcat|sprintf|vsprintf|strtok|gets|rand|srand|atoi|atof|alloca)\(' || true)"
report "first line is not the SPDX line" "$(for f in $sources; do head -n 1 "$f" | grep -q 'SPDX-License-Identifier. Apache-2.0' || echo "$f"; done)"
report "header guard is missing" "$(for f in $(echo "$sources" | tr ' ' '\n' | grep '\.h$' | grep -v '_body\.h$'); do grep -q '^#ifndef [A-Z]' "$f" || echo "$f"; done)"
report "file name not unique" "$(echo "$sources" | tr ' ' '\n' | grep -v '^client/include/' | sed 's|.*/||' | sort | uniq -d)"
report "leftover" "$(git ls-files '*.c' '*.h' '*.sh' '*.mk' '*.py' Makefile | grep -v '^tests/lint/' | xargs grep -nE 'TODO|FIXME|HACK|(^|[^X])XXX([^X]|$)' || true)"
report "line over 100 columns" "$(echo "$sources" | xargs awk 'length($0) > 100 { print FILENAME ":" FNR }' || true)"
report "file over 700 lines" "$(echo "$sources" | xargs wc -l | awk '$1 > 700 && $2 != "total" { print $2 ": " $1 }')"
report "function over 80 lines" "$(echo "$sources" | tr ' ' '\n' | grep '\.c$' | xargs awk '
    FNR == 1 { start = 0 }
    /^{/ { start = FNR }
    /^}/ { if (start && FNR - start > 80) print FILENAME ":" start ": " FNR - start " lines"; start = 0 }')"
report "test that cannot be executed" "$(git ls-files -s 'tests/*/test_*.py' 'tests/*/test_*.sh' | awk '$1 != "100755" { print $4 }')"
report "tab" "$(echo "$sources" | xargs grep -nP '\t' || true)"

report "name outside of the legend of prefixes (docs/ARCHITECTURE.md)" "$(python3 tests/lint/names.py || true)"
report "deploy/debian/libumbrage1.symbols is not client/exports" "$(for list in client/exports/*.txt; do
    awk -v lib="lib$(basename "$list" .txt).so" '/^lib/ { on = index($1, lib ".") == 1; next } on && /@/ && !/ UMBRAGE_1@/ { sub(/@.*/, ""); print $1 }' \
        deploy/debian/libumbrage1.symbols | LC_ALL=C sort | diff - "$list" | grep '^[<>]'; done || true)"
report "licence" "$(python3 tests/lint/licences.py || true)"
if command -v reuse >/dev/null; then
    report "reuse lint" "$(said=$(reuse lint 2>&1) || echo "$said" | tail -n 20)"
else
    echo "lint: reuse lint skipped: it is not installed (make deps-full installs it)"
fi
report "small header with a single user" "$(python3 tests/lint/small_headers.py || true)"

# Other versions of clang-format lay sources out differently.
version=$(clang-format --version 2>/dev/null | sed -n 's/.*version \([0-9]*\)\..*/\1/p')
if [ "$version" = 14 ]; then
    report "not laid out as .clang-format says: make format" "$(echo "$sources" | xargs clang-format --dry-run 2>&1 |
        sed -n 's/:\([0-9]*\):.*warning: code should be clang-formatted.*/:\1/p')"
else
    echo "lint: layout skipped: clang-format 14 is wanted, ${version:-none} is installed (make deps-full installs it)"
fi

[ "$failures" -eq 0 ] && echo "lint: ok"
exit "$failures"
