#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# tests/harness/run.sh by itself: verdicts, hidden skips, second tries, tests side by side and alone.
. "$(dirname "$0")/../harness/umbrage_test.sh"
unset CI TEST_ATTEMPTS TEST_UNSTEADY TEST_JOBS TEST_TIMEOUT
runner=$root/tests/harness/run.sh
cd "$folder" || exit 1

make_test() { # NAME: the script comes from stdin
    { echo '#!/bin/sh' && cat; } >"$1.sh"
    chmod +x "$1.sh"
}
closing() { # CODE LINE TEST...: the run's exit code and its last line
    wanted=$1 line=$2
    shift 2
    sh "$runner" "$@" >out 2>&1
    same "$(basename "$1"): exit code" "$wanted" $?
    same "$(basename "$1"): closing line" "$line" "$(tail -n 1 out)"
}

echo 'exit 0' | make_test good
echo 'echo the reason it broke; exit 3' | make_test broken
echo 'echo "skipped: no such tool"; exit 77' | make_test left_out
closing 0 "1 passed, 0 failed, 0 skipped" ./good.sh
closing 1 "1 passed, 1 failed, 1 skipped" ./broken.sh ./good.sh ./left_out.sh
check "a failed test shows its output" grep -q '^    the reason it broke$' out
check "a skip shows its reason" grep -q 'left_out.sh .* skipped: no such tool (' out
closing 1 "0 passed, 1 failed, 0 skipped" ./there_is_none.sh

make_test parts <<'SCRIPT'
echo "SKIPPED: h2spec: UMBRAGE_H2SPEC names none"
echo "[  SKIPPED ] a_case_of_cmocka"
echo "[  SKIPPED ] 1 test(s), listed below:"
SCRIPT
closing 0 "1 passed, 0 failed, 2 skipped" ./parts.sh
check "a skip inside a passing test is named" grep -q '^    skipped in it: h2spec: UMBRAGE_H2SPEC names none$' out
check "so is a skipped case of cmocka" grep -q '^    skipped in it: a_case_of_cmocka$' out

echo '[ -e tried ] && exit 0; touch tried; echo slow peer; exit 1' | make_test unsteady
TEST_ATTEMPTS=2 closing 0 "1 passed, 0 failed, 0 skipped" ./unsteady.sh
check "a pass at the second try is told" grep -q 'UNSTEADY: first exit 1' out
check "with the output of the first" grep -q '^    first: slow peer$' out
rm tried
TEST_ATTEMPTS=2 CI=true closing 1 "0 passed, 1 failed, 0 skipped" ./unsteady.sh
rm tried
TEST_ATTEMPTS=2 TEST_UNSTEADY=fail closing 1 "0 passed, 1 failed, 0 skipped" ./unsteady.sh
rm tried
echo '[ -e tried ] && exit 0; touch tried; echo "runtime error: left shift"; exit 1' | make_test sanitizer
TEST_ATTEMPTS=2 closing 1 "0 passed, 1 failed, 0 skipped" ./sanitizer.sh

# Two tests that wait for one another pass only side by side.
for pair in one:other other:one; do
    make_test "${pair%:*}" <<SCRIPT
touch met_${pair%:*}
for i in \$(seq 600); do [ -e met_${pair#*:} ] && exit 0; sleep 0.05; done
exit 1
SCRIPT
done
TEST_JOBS=2 closing 0 "2 passed, 0 failed, 0 skipped" ./one.sh ./other.sh

# The table of times: tests that mostly wait (here five) share two processors, tests that keep two
# processors busy take turns, and the longest begins first.
waiters=
for name in a b c d e; do
    echo "2.0 0.2 waiter_$name.sh" >>times
    waiters="$waiters ./waiter_$name.sh"
    make_test waiter_$name <<SCRIPT
touch here_$name
for i in \$(seq 600); do [ "\$(ls here_? | wc -l)" -eq 5 ] && exit 0; sleep 0.05; done
exit 1
SCRIPT
done
# shellcheck disable=SC2086
TEST_TIMES=$folder/times TEST_JOBS=2 closing 0 "5 passed, 0 failed, 0 skipped" $waiters
for pair in short:1 longest:9 long:5; do
    echo "${pair#*:}.0 $((2 * ${pair#*:})).0 ${pair%:*}.sh" >>times
    make_test "${pair%:*}" <<SCRIPT
mkdir both || exit 1
echo ${pair%:*} >>order
for i in \$(seq 4); do sleep 0.05; done
rmdir both
SCRIPT
done
TEST_TIMES=$folder/times TEST_JOBS=2 closing 0 "3 passed, 0 failed, 0 skipped" ./short.sh ./longest.sh ./long.sh
same "the longest begins first" "longest long short" "$(tr '\n' ' ' <order | sed 's/ $//')"
echo 'sleep 1' | make_test sleeps
echo "3.0 1.0 sleeps.sh" >new
TEST_TIMES=$folder/new TEST_RECORD=1 closing 0 "2 passed, 0 failed, 0 skipped" ./good.sh ./sleeps.sh
check "times of a second and more are written" grep -qE '^[12]\.[0-9] 0\.[0-9] sleeps\.sh$' new
same "and no others" 1 "$(wc -l <new)"

# A marked test begins when all others have ended, and marked ones take turns.
for name in first second third; do
    mark=$([ $name = first ] || echo '# run: alone (it counts who is there)')
    make_test $name <<SCRIPT
$mark
mkdir running || exit 1
for i in \$(seq 8); do sleep 0.05; done
rmdir running
SCRIPT
done
TEST_JOBS=3 closing 0 "3 passed, 0 failed, 0 skipped" ./third.sh ./first.sh ./second.sh

# A test that hangs must be ended with the processes that it started, also with one that ignores
# SIGTERM.
make_test hangs <<'SCRIPT'
(trap '' TERM; exec sleep 100) &
echo $! >sleeper
wait
SCRIPT
TEST_TIMEOUT=1 closing 1 "0 passed, 1 failed, 0 skipped" ./hangs.sh
check "the time-out is told" grep -q 'ended after 1 s' out
state=$(sed 's/.*) \(.\).*/\1/' "/proc/$(cat sleeper)/stat" 2>/dev/null || echo gone)
check "its processes are gone" sh -c "case '$state' in Z | X | gone) ;; *) exit 1 ;; esac"
finish
