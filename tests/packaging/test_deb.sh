#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The Debian packages by lintian, and in a bare Debian 12 root without a compiler: README's commands lead to an answer
# within 60 s; purging leaves the stores and nothing else; upgrade and downgrade keep stores, jobs and configuration.
#
#   DEBS=DIR          the packages (default: those of `make deb`)
#   DEBS_BEFORE=DIR   packages of an earlier build, from which the test upgrades (default: these ones, repacked with a
#                     lower version and another configuration)
. "$(dirname "$0")/../harness/umbrage_test.sh"
. "$(dirname "$0")/bare_root.sh"
cd "$root" || exit 1
set -- "${DEBS:-$BUILD/deb}"/*.deb
[ -e "$1" ] || {
    echo "no packages in ${DEBS:-$BUILD/deb}: make deb"
    exit 1
}
if command -v lintian >/dev/null; then
    lintian --allow-root --fail-on error,warning "$@" >"$folder/lintian" 2>&1
    same "lintian has no error and no warning" "0 " "$? $(cat "$folder/lintian")"
else
    left_out "lintian" "it is not installed"
fi
need_bare_root

new_root bare
mkdir "$folder/bare/debs"
cp "$@" "$folder/bare/debs"

# A first answer by README's commands.
{
    echo 'cd /debs && begin=$(date +%s)'
    page_block README.md install-deb
    echo "$stop_watch"
} >"$folder/first"
check "README has the commands" grep -q 'umbrage query' "$folder/first"
in_root bare --net <"$folder/first"
same "README's commands succeed in a bare root" 0 $?
tail -n 3 "$folder/bare.log"
check "the answer is the wall's shadow" grep -qx 0 "$folder/bare.log"
in_time "$folder/bare/seconds"
same "no compiler came with them" "" "$(ls "$folder/bare/usr/bin" | grep -E '^(gcc|cc|clang|c\+\+)' | tr '\n' ' ')"
in_root bare <<'SCRIPT'
cd /tmp
python3 -c '
import umbrage
with umbrage.open("/debs/wall.umb") as asset:
    print(umbrage.__name__, len(asset.lights), asset.query([[0, 2, 0]], taps=9)[0])'
umbrage-bake --version && umbrage-study --version && umbraged --version
umbrage view /debs/wall.umb --scene /usr/share/doc/umbrage/docs/examples/wall.obj --export /tmp/page
ls /tmp/page/*.html && find /tmp/page/ -name 'three.module*.js' | grep .
umbraged --config /etc/umbraged/umbraged.conf --check-config
find /usr/share/man -name 'umbrage*' | grep -q umbraged.8
id umbrage
stat -c '%U %a' /var/lib/umbrage
SCRIPT
same "module, programs, user and store are there" 0 $?
same "the store is the daemon's" "umbrage 2775" "$(tail -n 1 "$folder/bare.log")"

# Purging. The dependencies stay, so that what differs is ours; a second round has a store, jobs and a cache.
cat >"$folder/purge" <<'SCRIPT'
apt-get purge -y $(dpkg-query -W -f '${Package}\n' '*umbrage*') >/dev/null
rm -rf /debs/wall.*
find / -xdev \( -path /proc -o -path /run -o -path /var/lib/dpkg -o -path /var/lib/apt -o -path /var/cache -o -path /var/log \
    -o -path /debs -o -path /tmp -o -path /script \) -prune -o -print | sort
find /var/cache -path /var/cache/apt -prune -o -print | sort
SCRIPT
purge_list() { in_root bare <"$folder/purge" && grep '^/' "$folder/bare.log"; }
purge_list >"$folder/clean" || bad "purge" "$(tail -n 5 "$folder/bare.log")"
same "purging leaves no file" "/var/lib/umbrage" "$(grep -i umbrage "$folder/clean")"
cat >"$folder/serve" <<'SCRIPT'
start() {
    mkdir -p /run/umbrage && chown umbrage:umbrage /run/umbrage # as the unit's RuntimeDirectory and its like
    install -d -o umbrage -g umbrage -m 0700 /var/lib/umbrage-jobs /var/cache/umbrage
    setpriv --reuid umbrage --regid umbrage --clear-groups umbraged --config /etc/umbraged/umbraged.conf \
        --listen unix:/run/umbrage/socket --cache /var/cache/umbrage --jobs /var/lib/umbrage-jobs \
        --job-sandbox available --drain-delay 0 >/var/log/umbraged.test 2>&1 &
    daemon=$!
    export UMBRAGE_ADDRESS=unix:/run/umbrage/socket
    for i in $(seq 600); do
        umbrage list >/dev/null 2>&1 && return
        sleep 0.1
    done
    cat /var/log/umbraged.test
    exit 1
}
told() {
    echo '0 2 0' | umbrage query wall --points - --taps 9
    umbrage list
    umbrage jobs
    md5sum /etc/umbraged/umbraged.conf
}
stop() {
    kill $daemon && wait $daemon
}
SCRIPT
{
    echo 'cd /debs'
    page_block README.md install-deb
    cat "$folder/serve"
    cat <<'SCRIPT'
echo '; changed here' >>/etc/umbraged/umbraged.conf
install -o umbrage -g umbrage -m 0644 wall.umb /var/lib/umbrage/wall.umb
start
umbrage submit /usr/share/doc/umbrage/docs/examples/wall.obj --up z --sun 180,45 --resolution 256 --wait --quiet
told >/told.before
[ "$(ls /var/cache/umbrage | wc -l)" -gt 0 ]
stop
SCRIPT
} >"$folder/used"
in_root bare <"$folder/used"
same "the installed daemon serves its store and bakes a job" 0 $?
check "and what it serves is told" grep -q done "$folder/bare/told.before"
purge_list >"$folder/left"
grep -vxF -f "$folder/clean" "$folder/left" | grep -v '^/told' | grep -vE '^/var/lib/umbrage(-jobs)?(/|$)' >"$folder/more"
same "purging after use leaves nothing but stores and jobs" "" "$(tr '\n' ' ' <"$folder/more")"
check "the store stays" grep -qx /var/lib/umbrage/wall.umb "$folder/left"
check "the jobs stay" grep -q '^/var/lib/umbrage-jobs/jobs.db' "$folder/left"

# Upgrade and downgrade.
before=${DEBS_BEFORE:-$folder/before}
if [ -z "${DEBS_BEFORE:-}" ]; then
    mkdir "$before"
    for deb; do
        dpkg-deb -R "$deb" "$folder/unpacked"
        sed -Ei 's/([0-9]+\.[0-9]+\.[0-9]+)-1\b/\1-0/g' "$folder/unpacked/DEBIAN/control"
        conf=$folder/unpacked/etc/umbraged/umbraged.conf
        [ ! -e "$conf" ] || {
            echo '; of an earlier version' >>"$conf"
            (cd "$folder/unpacked" && find . -type f ! -path './DEBIAN/*' -printf '%P\0' | xargs -0 md5sum >DEBIAN/md5sums)
        }
        dpkg-deb -b --root-owner-group "$folder/unpacked" "$before" >/dev/null
        rm -rf "$folder/unpacked"
    done
fi
mkdir "$folder/bare/before"
cp "$before"/*.deb "$folder/bare/before"
for place in before debs before; do
    {
        echo 'apt-get install -y --allow-downgrades -o Dpkg::Options::=--force-confold' "/$place/*.deb >/dev/null"
        echo "dpkg-query -W -f '\${Version}\n' umbraged"
        cat "$folder/serve"
        [ -e "$folder/bare/told.first" ] || echo "echo '; changed here' >>/etc/umbraged/umbraged.conf"
        echo 'start'
        echo '[ -e /told.first ] || told >/told.first'
        echo 'told >/told.now'
        echo 'stop'
        echo 'grep -x "; changed here" /etc/umbraged/umbraged.conf'
    } | in_root bare
    same "the packages of $place are installed over the others" 0 $?
    grep -E '^[0-9]+\.' "$folder/bare.log" | tail -n 1
    check "the daemon tells of them" test -s "$folder/bare/told.now"
    same "store, jobs and configuration are the same" "$(cat "$folder/bare/told.first")" "$(cat "$folder/bare/told.now")"
done
check "the job of before the purge is told too" grep -q done "$folder/bare/told.now"
finish
