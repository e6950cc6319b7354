#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh TEST...: runs each test in its own process under a timeout, shows the output of those that
# fail, and ends with one line "N passed, N failed, N skipped". A test is skipped by exit code 77.
# TEST_ATTEMPTS=2 runs a failed test once more, unless a sanitizer spoke: tests of real processes
# share their machine with others. One that passes only then is shown with the first failure and
# counted apart as unsteady; it is a bug to be found, in the test or in what it tests.
set -u
TSAN_OPTIONS="suppressions=$(cd "$(dirname "$0")" && pwd)/tsan.supp ${TSAN_OPTIONS:-}"
export TSAN_OPTIONS
passed=0 failed=0 skipped=0 unsteady=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT
for test in "$@"; do
    begin=$(date +%s)
    timeout "${TEST_TIMEOUT:-600}" "$test" >"$log" 2>&1
    code=$? first=0
    if [ $code -ne 0 ] && [ $code -ne 77 ] && [ "${TEST_ATTEMPTS:-1}" -gt 1 ] &&
        ! grep -q 'Sanitizer\|runtime error:' "$log"; then
        first=$code
        sed 's/^/    first: /' "$log" | tail -n 60
        timeout "${TEST_TIMEOUT:-600}" "$test" >"$log" 2>&1
        code=$?
    fi
    seconds=$(($(date +%s) - begin))
    case $code in
    0) passed=$((passed + 1)) verdict=ok
        [ $first -eq 0 ] || { unsteady=$((unsteady + 1)) verdict="ok, UNSTEADY: first exit $first"; } ;;
    77) skipped=$((skipped + 1)) verdict="skipped: $(tail -n 1 "$log")" ;;
    *) failed=$((failed + 1)) verdict="FAILED (exit $code)" ;;
    esac
    printf '%-60s %s (%d s)\n' "$test" "$verdict" "$seconds"
    if [ $code -ne 0 ] && [ $code -ne 77 ]; then
        sed 's/^/    /' "$log" | tail -n 60
    fi
done
[ $unsteady -eq 0 ] || echo "$unsteady of the passed were UNSTEADY"
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" -eq 0 ]
