#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The contents of deploy/ are complete: an installation runs, man pages agree with --help, the unit
# is hardened, and the metrics that Prometheus and Grafana use are those that the daemon serves.
. "$(dirname "$0")/../harness/umbrage_test.sh"
cd "$root" || exit 1

# Under make its variables are in the environment; in a run by hand the build folder's name gives
# the kind of build.
config=$(basename "$BUILD")
case $config in
release | debug | asan | tsan) set -- "config=$config" ;;
*) set -- ;;
esac
[ -z "${MAKEFLAGS:-}" ] || set --
set -- make --no-print-directory "$@" BUILD="$BUILD" install DESTDIR="$folder/root" PREFIX=/usr
if "$@" >"$folder/make" 2>&1; then
    ok "make install"
else
    bad "make install" "$(tail -n 5 "$folder/make")"
fi
# However the build folder is named, its objects depend on their headers.
for name in "$BUILD" "${BUILD#"$root"/}" "./${BUILD#"$root"/}"; do
    "$@" -n BUILD="$name" -W client/include/umbrage/status.h 2>&1 | grep -c '  CC server/daemon/'
done | sort -u >"$folder/stale"
check "a header that changed is heeded under each name of the build folder" \
    awk 'END { exit NR != 1 || $1 < 20 }' "$folder/stale"
# A library that a build may do without can be switched on or off in a folder that is already built;
# the build must follow.
for with in "" yes; do
    "$@" -n "IPSEC_MB=$with" 2>&1 | grep -q 'server/common/sha256_lanes\.c' && echo compiled || echo kept
done | sort >"$folder/switched"
same "with or without libipsec-mb: what is not built so is compiled anew" "compiled kept " "$(tr '\n' ' ' <"$folder/switched")"
installed=$folder/root/usr
for file in bin/umbraged bin/umbrage bin/umbrage-bake bin/umbrage-study lib/libumbrage-core.a \
    include/umbrage/query.h share/man/man8/umbraged.8 share/man/man1/umbrage.1 share/man/man1/umbrage-bake.1 \
    share/man/man5/umbraged.conf.5 lib/systemd/system/umbraged.service lib/systemd/system/umbraged.socket lib/sysusers.d/umbrage.conf \
    lib/tmpfiles.d/umbrage.conf share/umbrage/haproxy.cfg share/umbrage/umbrage-assets.conf share/umbrage/Caddyfile share/umbrage/proto/umbrage/v1/shadows.proto share/umbrage/gpu/umbrage.wgsl share/umbrage/umbrage-alerts.yml \
    share/bash-completion/completions/umbraged share/zsh/site-functions/_umbrage share/fish/vendor_completions.d/umbrage-bake.fish ../etc/umbraged/umbraged.conf; do
    [ -s "$installed/$file" ] || bad "$file is installed" ""
done
find "$installed/share/doc/umbrage" -name '*.md' | while read -r page; do
    grep -oE '(\]\(|src=")[^)"#: ]+' "$page" | sed -E 's/^(\]\(|src=")//' | while read -r link; do
        [ -e "$(dirname "$page")/$link" ] || echo "$(basename "$page"): $link"
    done
done >"$folder/dangling"
check "the installed pages are there" test -s "$installed/share/doc/umbrage/docs/reference/operations.md"
same "each of their links leads somewhere" "" "$(head -n 5 "$folder/dangling")"
echo changed >>"$folder/root/etc/umbraged/umbraged.conf"
"$@" >/dev/null 2>&1
same "a configuration that is there stays" changed "$(tail -n 1 "$folder/root/etc/umbraged/umbraged.conf")"
same "the installed daemon runs" "umbraged" "$("$installed/bin/umbraged" --version | cut -d ' ' -f 1)"
"$installed/bin/umbraged" --config deploy/umbraged.conf --check-config 2>"$folder/err"
same "the shipped configuration is good" "" "$(cat "$folder/err")"

# Man pages: every option and every command of --help, as a reader sees it.
if command -v man >/dev/null; then
    for page in man8/umbraged.8 man1/umbrage-bake.1 man1/umbrage.1 man5/umbraged.conf.5; do
        MANWIDTH=160 man --warnings -E ascii -l "$installed/share/man/$page" 2>"$folder/warnings" | col -b >"$folder/$(basename $page)"
        same "$page has no errors" "" "$(cat "$folder/warnings")"
    done
    for pair in umbraged:umbraged.8 umbrage-bake:umbrage-bake.1 umbrage:umbrage.1; do
        "$BUILD/${pair%%:*}" --help | grep -oE -- '--[a-z][a-z-]+' | sort -u >"$folder/options"
        grep -oE -- '--[a-z][a-z-]+' "$folder/${pair##*:}" | sort -u >"$folder/told"
        same "${pair##*:} has every option" "" "$(comm -23 "$folder/options" "$folder/told" | tr '\n' ' ')"
    done
    "$BUILD/umbrage" --help | sed -n 's/^  \([a-z]*\)  .*/\1/p' | grep -vE '^(bake|help|version)$' | while read -r command; do
        grep -qE "umbrage(-study)? $command " "$folder/umbrage.1" || echo "$command"
    done >"$folder/missing"
    same "umbrage.1 has every command" "" "$(cat "$folder/missing")"
    "$BUILD/umbraged" --store x --print-config | sed -n 's/^;* *\([a-z-]*\) =.*/\1/p' | while read -r name; do
        grep -qE "^ *;? ?$name =" "$folder/umbraged.conf.5" || echo "$name"
    done >"$folder/missing"
    same "umbraged.conf.5 has every setting" "" "$(cat "$folder/missing")"
else
    left_out "man pages" "man is not installed"
fi

# A failure in the service must end the service only: it has its own limits, so that other services
# do not end first.
unit=$installed/lib/systemd/system/umbraged.service
for bound in MemoryHigh MemoryMax TasksMax; do
    check "the unit has $bound" grep -qE "^$bound=[0-9]+%?$" "$unit"
done
same "others do not die before it" "" "$(grep -E '^OOMScoreAdjust=-' "$unit")"

if command -v systemd-analyze >/dev/null; then
    exposure=$(systemd-analyze security --offline=true "$installed/lib/systemd/system/umbraged.service" 2>/dev/null |
        sed -n 's/.*exposure level.*: \([0-9.]*\) .*/\1/p')
    echo "exposure $exposure"
    # Checks the drop-in for --jobs in the place where an operator puts it, without the units of
    # systemd itself.
    mkdir -p "$folder/jobs/etc/systemd/system/umbraged.service.d"
    cp "$installed/lib/systemd/system/umbraged.service" "$folder/jobs/etc/systemd/system/"
    cp "$installed/share/umbrage/umbraged-jobs.conf" "$folder/jobs/etc/systemd/system/umbraged.service.d/jobs.conf"
    with_jobs=$(systemd-analyze security --offline=true --root="$folder/jobs" umbraged.service 2>"$folder/err" |
        tee "$folder/jobs.txt" | sed -n 's/.*exposure level.*: \([0-9.]*\) .*/\1/p')
    same "the drop-in for jobs has no errors" "" "$(grep -i 'unknown\|failed to parse\|ignoring' "$folder/err")"
    echo "exposure with jobs $with_jobs"
    same "with jobs it is 2.0 at most too" yes "$(awk "BEGIN { print (\"$with_jobs\" != \"\" && $with_jobs <= 2.0 && $with_jobs > $exposure) ? \"yes\" : \"no\" }")"
    same "the unit's exposure is 2.0 at most" yes "$(awk "BEGIN { print (\"$exposure\" != \"\" && $exposure <= 2.0) ? \"yes\" : \"no\" }")"
else
    left_out "exposure of the unit" "systemd-analyze is not installed"
fi
if command -v promtool >/dev/null; then
    promtool check config deploy/prometheus/umbrage.yml >"$folder/out" 2>&1
    same "promtool takes the rules" 0 $?
else
    left_out "Prometheus rules" "promtool is not installed"
fi
if command -v haproxy >/dev/null; then
    UMBRAGE_FRONTEND=127.0.0.1:1 UMBRAGE_R1=127.0.0.1:2 UMBRAGE_R2=127.0.0.1:3 UMBRAGE_R3=127.0.0.1:4 \
        haproxy -c -f deploy/haproxy/haproxy.cfg >"$folder/out" 2>&1
    same "haproxy takes its configuration" 0 $?
else
    left_out "HAProxy configuration" "haproxy is not installed"
fi

operations=docs/reference/operations.md
# The metrics that alerts and panels name must be those that operations.md lists (test_docs.sh
# compares that list with what is served).
grep -ohE '(umbrage|grpc_server|process)_[a-z0-9_]+' deploy/prometheus/*.yml deploy/grafana/*.json |
    sed 's/_bucket$//' | grep -v '^umbrage_alerts' | sort -u >"$folder/asked"
grep -ohE '`(umbrage|grpc_server|process)_[a-z0-9_]+' "$operations" | tr -d '`' |
    sort -u >"$folder/listed"
same "alerts and panels ask for metrics that exist" "" "$(comm -23 "$folder/asked" "$folder/listed" | tr '\n' ' ')"
sed -n 's/.*- alert: //p' deploy/prometheus/umbrage-alerts.yml | sort >"$folder/alerts"
grep -oE '^\| `Umbrage[A-Za-z]+' "$operations" | tr -d '|` ' | sort >"$folder/explained"
same "every alert is explained in $operations" "$(cat "$folder/alerts")" "$(cat "$folder/explained")"
/usr/bin/python3 -m json.tool deploy/grafana/umbrage.json >/dev/null
same "the dashboard is JSON" 0 $?
finish
