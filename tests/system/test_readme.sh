#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The five minutes of README.md, word for word, but smaller and on ports of their own.
. "$(dirname "$0")/../harness/umbrage_test.sh"

# section LANGUAGE: the lines of the tour's code blocks in one language.
section() {
    awk -v fence="\`\`\`$1" '/^## /{ tour = /^## Five minutes/ }
        /^```/{ inside = tour && $0 == fence; next } inside' "$root/README.md"
}

# Two ports that are free now.
ports=$(/usr/bin/python3 -c '
import socket
held = [socket.socket() for _ in range(2)]
for s in held:
    s.bind(("127.0.0.1", 0))
print(*(s.getsockname()[1] for s in held))')
port=${ports% *} admin=${ports#* }
smaller() {
    sed -e "s|\$PWD/build/release|$BUILD|; s|/tmp/umbrage.sock|$folder/socket|; s/7420/$port/; s/9464/$admin/" \
        -e 's/--size 50/--size 5/; s/16384/1024 --verify 20000/; s/^umbrage render/& --size 160x90/' \
        -e 's/^umbrage points/& --count 1000/; s/^umbrage verify/& --points 10000/' \
        -e 's/--quick/& --max-resolution 512 --points 1000 --truth 2/'
}

mkdir "$folder/tree"
ln -s "$root/proto" "$folder/tree/proto"
cd "$folder/tree" || exit 1
{
    echo "set -eu"
    section sh | smaller
} >"$folder/tour.sh"
check "the tour has commands" test "$(wc -l <"$folder/tour.sh")" -gt 15
echo 'echo $! >daemon.pid' >"$folder/pid"
sed -i "/^umbraged/r $folder/pid" "$folder/tour.sh"
UMBRAGE_ADDRESS=tcp:127.0.0.1:$port PATH=$BUILD:$PATH timeout 100 sh "$folder/tour.sh" >"$folder/out" 2>"$folder/err"
same "every command of the tour succeeds" 0 $?
cd demo-out || exit 1
[ -s daemon.pid ] && children=$(cat daemon.pid)
for file in city.png street.part load.html answers.u8 store/city.umb study/report.html; do
    check "the tour makes $file" test -s $file
done

# The lines of C are those of docs/examples/ask_file.c, which answers as the command does.
awk '/```c$/{ inside = 1; next } /^```/{ inside = 0 } inside' "$root/README.md" >"$folder/told.c"
awk '/snippet ends/{ inside = 0 } inside { sub(/^    /, ""); print } /snippet begins/{ inside = 1 }' \
    "$root/docs/examples/ask_file.c" | cmp -s - "$folder/told.c"
same "README shows the lines of docs/examples/ask_file.c" 0 $?
${CC:-cc} -std=c99 -Wall -Wextra -Werror -I"$root/client/include" "$root/docs/examples/ask_file.c" -L"$BUILD" \
    -Wl,-rpath,"$BUILD" -l:libumbrage-core.so.1 -o "$folder/query" 2>"$folder/err"
same "the C program compiles" 0 $?
printf '10 2 10 0 1 0\n-40 0.5 12 0 1 0\n15 0.5 -20 0 1 0\n' >"$folder/points"
"$BUILD/umbrage" query store/city.umb --points - --taps 9 --quiet <"$folder/points" >"$folder/wanted"
same "it gets the answers of the command line" "$(cat "$folder/wanted")" "$("$folder/query" store/city.umb <"$folder/points")"
printf '10 2 10 0 1 0\n-40 0.5 x\n' | "$folder/query" store/city.umb >"$folder/out" 2>"$folder/err"
same "it refuses a line that has other than six numbers" "1 0" "$? $(wc -l <"$folder/out")"
yes '10 2 10 0 1 0' | head -n 65537 | "$folder/query" store/city.umb >"$folder/out" 2>"$folder/err"
same "it refuses more points than it has room for" "1 0" "$? $(wc -l <"$folder/out")"

section python | smaller >tour.py
if ! /usr/bin/python3 -c 'import numpy, cffi' 2>/dev/null; then
    left_out "the tour in Python" "python3-numpy or python3-cffi is not installed"
else
    PYTHONPATH=$BUILD/python LD_LIBRARY_PATH=$BUILD timeout 30 /usr/bin/python3 tour.py >"$folder/python" 2>"$folder/err"
    printf '10 2 10\n-40 0.5 12\n' | "$BUILD/umbrage" query store/city.umb --points - --taps 9 --quiet | xargs >"$folder/wanted"
    same "Python gets the answers of the command line" "$(awk '{ for (i = 1; i <= NF; i++) printf "%.6f ", $i }' "$folder/wanted")" \
        "$(tr -d '[],' <"$folder/python" | awk '{ for (i = 1; i <= NF; i++) printf "%.6f ", $i }')"
fi
finish
