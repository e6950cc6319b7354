#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh TEST...: runs each test in its own process under a timeout, shows the output of those that
# fail, and ends with one line "N passed, N failed, N skipped". A test is skipped by exit code 77.
set -u
TSAN_OPTIONS="suppressions=$(cd "$(dirname "$0")" && pwd)/tsan.supp ${TSAN_OPTIONS:-}"
export TSAN_OPTIONS
passed=0 failed=0 skipped=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT
for test in "$@"; do
    begin=$(date +%s)
    timeout "${TEST_TIMEOUT:-600}" "$test" >"$log" 2>&1
    code=$?
    seconds=$(($(date +%s) - begin))
    case $code in
    0) passed=$((passed + 1)) verdict=ok ;;
    77) skipped=$((skipped + 1)) verdict="skipped: $(tail -n 1 "$log")" ;;
    *) failed=$((failed + 1)) verdict="FAILED (exit $code)" ;;
    esac
    printf '%-60s %s (%d s)\n' "$test" "$verdict" "$seconds"
    if [ "$verdict" != ok ] && [ $code -ne 77 ]; then
        sed 's/^/    /' "$log" | tail -n 60
    fi
done
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ]
