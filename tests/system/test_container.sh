#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# deploy/Containerfile: pinned base, user, callers, start and health check. Builds no image.
. "$(dirname "$0")/../harness/umbrage_test.sh"
cd "$root" || exit 1
file=deploy/Containerfile
# One line an instruction, comments gone; the last stage is what runs.
sed -e '/^#/d' -e ':a' -e '/\\$/{N;ba' -e '}' -e 's/\\\n *//g' "$file" >"$folder/lines"
sed -n '/^FROM/h;/^FROM/!H;${x;p}' "$folder/lines" >"$folder/stage"
last() { # INSTRUCTION: its words, as JSON or as they stand
    sed -n "s/^$1 //p" "$folder/stage" | tail -n 1
}

same "every base is named by a digest" "" "$(grep '^FROM' "$folder/lines" | grep -vE '@\$\{BASE_DIGEST\} |^FROM dated( |$)')"
# Packages of the day on which the base was made: the command, run on the base's list of sources.
cat >"$folder/debian.sources" <<'SOURCES'
Types: deb
# http://snapshot.example/archive/debian/20250520T000000Z
URIs: http://mirror.example/debian
Suites: bookworm bookworm-updates
Components: main
SOURCES
pin=$(sed -n "s/^RUN \(sed -i .*\)/\1/p" "$folder/lines" | sed "s|/etc/apt/sources.list.d|$folder|g; s|/etc/apt/apt.conf.d|$folder|g")
sh -c "$pin"
same "its packages come from the base's snapshot" "URIs: http://snapshot.example/archive/debian/20250520T000000Z" \
    "$(grep '^URIs' "$folder/debian.sources")"
check "which may be older than a week" grep -q 'Check-Valid-Until "false"' "$folder/90snapshot"
pinned=$(sed -n 's/^ARG BASE_DIGEST=//p' "$folder/lines")
check "the file pins the digest" sh -c "echo '$pinned' | grep -qxE 'sha256:[0-9a-f]{64}'"
same "and has no other argument" "ARG BASE_DIGEST=$pinned" "$(grep '^ARG' "$folder/lines")"
check "it runs as a number that is not root" sh -c "echo '$(last USER)' | grep -qE '^[1-9][0-9]*:[1-9][0-9]*$'"
for program in umbraged umbrage umbrage-bake; do
    check "it has $program" sh -c "grep '^COPY --from=build' '$folder/stage' | grep -q '/usr/bin/$program '"
done

# Every library that the programs are linked with must come from a package that the stage installs.
if command -v dpkg-query >/dev/null && command -v readelf >/dev/null; then
    grep -oE '[a-z0-9.+-]+' "$folder/stage" | sort -u >"$folder/installed"
    for program in umbraged umbrage umbrage-bake; do
        ldd "$BUILD/$program" | awk '{ print $1, $3 }' >"$folder/libraries"
        readelf -d "$BUILD/$program" | sed -n 's/.*NEEDED.*\[\(.*\)\]/\1/p' | while read -r library; do
            path=$(readlink -f "$(awk -v l="$library" '$1 == l { print $2 }' "$folder/libraries")")
            dpkg-query -S "$path" 2>/dev/null | cut -d : -f 1
        done
    done | sort -u | grep -v '^libc6$' >"$folder/wanted"
    check "packages of the libraries are known" grep -q libuv1 "$folder/wanted"
    same "every package that the programs need is installed" "" "$(comm -23 "$folder/wanted" "$folder/installed" | tr '\n' ' ')"
else
    left_out "packages of the libraries" "dpkg or readelf is not installed"
fi

# The entry point, as it stands, on a store of ours.
entry=$(last ENTRYPOINT | tr -d '[]",')
mkdir "$folder/store"
set -- $(echo "$entry" | sed -e 's|^umbraged ||' -e "s|/var/lib/umbrage|$folder/store|")
timeout 20 "$BUILD/umbraged" "$@" >"$folder/out" 2>"$folder/err" </dev/null
same "without the secret it does not start" 66 $?
check "and says which file is missing" grep -q -- "--token-file: cannot open '/run/secrets/umbrage-tokens'" "$folder/err"
check "it would listen for other machines" sh -c "echo '$entry' | grep -q 'tcp:0.0.0.0:7420'"
same "it does not go without tokens" "" "$(echo "$entry" | grep -e --without-tokens)"

# Runs the health check with a daemon that requires tokens.
health=$(sed -n 's/^HEALTHCHECK .*CMD //p' "$folder/stage" | tr -d '[]",')
if command -v curl >/dev/null; then
    (umask 077 && echo "studio query 0123456789abcdef" >"$folder/tokens")
    "$BUILD/umbraged" --store "$folder/store" --listen "unix:$folder/socket" --admin 127.0.0.1:0 \
        --token-file "$folder/tokens" >"$folder/log" 2>&1 &
    children=$!
    for i in $(seq 600); do
        admin=$(sed -n 's/.*event=admin address="http:\([^"]*\)".*/\1/p' "$folder/log")
        [ -z "$admin" ] || break
        sleep 0.05
    done
    here=$(echo "$health" | sed "s|127.0.0.1:9464|$admin|")
    check "the health check passes where tokens are asked for" $here
    kill "$children" && wait "$children"
    if $here >"$folder/out" 2>&1; then bad "it fails where no daemon is" "$here"; else ok "it fails where no daemon is"; fi
else
    left_out "the health check" "curl is not installed"
fi

# deploy/container.sh must accept a digest and nothing else.
cat >"$folder/builder" <<'SCRIPT'
#!/bin/sh
printf '%s\n' "$*"
SCRIPT
chmod +x "$folder/builder"
good=sha256:$(printf '%064d' 7)
for wrong in latest "sha256:" "sha256:$(printf '%063d' 7)" "sha256:$(printf '%065d' 7)" "$(printf '%064d' 7)" "sha256:$(printf 'X%063d' 7)"; do
    BUILDER=$folder/builder sh deploy/container.sh "$wrong" >"$folder/out" 2>"$folder/err"
    same "'$wrong' is no digest" "2 0" "$? $(wc -c <"$folder/out")"
done
same "a digest goes to the builder" "build --build-arg BASE_DIGEST=$good --file deploy/Containerfile --tag mine ." \
    "$(BUILDER=$folder/builder sh deploy/container.sh "$good" mine)"
same "without one the Containerfile's goes there" "build --build-arg BASE_DIGEST=$pinned --file deploy/Containerfile --tag umbrage ." \
    "$(BUILDER=$folder/builder sh deploy/container.sh)"
same "with an empty one too" "build --build-arg BASE_DIGEST=$pinned --file deploy/Containerfile --tag mine ." \
    "$(BUILDER=$folder/builder sh deploy/container.sh "" mine)"
finish
