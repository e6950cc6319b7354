#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# reproducible.sh: makes a release of the last commit twice, in clones that differ in path (one has spaces), time, time
# zone, locale, umask, home folder and number of jobs, and compares every file bit for bit.
. "$(dirname "$0")/../harness/umbrage_test.sh"
cd "$root" || exit 1
for program in dpkg-buildpackage dh dh_python3; do
    command -v "$program" >/dev/null || {
        echo "skipped: $program is not installed"
        exit 77
    }
done
work=$BUILD/reproducible
rm -rf "$work"
mkdir -p "$work/second/and its/longer"

# A locale that sorts and prints otherwise: in Estonian z comes before t, and numbers have commas.
if localedef -i et_EE -f UTF-8 "$folder/et_EE.UTF-8" 2>/dev/null; then
    locale="LOCPATH=$folder LC_ALL=et_EE.UTF-8 LANG=et_EE.UTF-8"
else
    locale=LC_ALL=C.UTF-8
    left_out "another locale" "localedef cannot make et_EE.UTF-8 (package locales)"
fi
later=
if command -v faketime >/dev/null; then
    later="faketime -f +397d"
else
    left_out "another time" "faketime is not installed"
fi

# release PLACE UMASK JOBS WORD...: clones the commit to PLACE and makes a release, in an environment of WORDs.
release() {
    place=$1 mask=$2 jobs=$3
    shift 3
    git clone -q --no-hardlinks "$root" "$place" && git -C "$place" reset -q --hard "$commit" && mkdir -p "$place.home" &&
        (umask "$mask" && cd "$place" && env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME="$place.home" \
            DEB_BUILD_OPTIONS="parallel=$jobs" "$@" make -j"$jobs" release) >"$place.log" 2>&1
}

commit=$(git rev-parse HEAD)
begin=$(date +%s)
release "$work/one" 022 2 LC_ALL=C TZ=UTC
same "a release is built" 0 $?
# Words of $later and $locale are split on purpose.
# shellcheck disable=SC2086
release "$work/second/and its/longer path" 077 3 TZ=Pacific/Kiritimati USER=builder $locale $later
same "another is built elsewhere, later, by other settings" 0 $?
echo "two releases took $(($(date +%s) - begin)) s"
tail -n 3 "$work/one.log" "$work/second/and its/longer path.log"
one=$work/one/build/release/dist two="$work/second/and its/longer path/build/release/dist"
packages=$(sed -n 's/^Package: //p' deploy/debian/control | sed "s|.*|$one/&_*.deb|")
# A word a pattern.
# shellcheck disable=SC2086
check "the release has all its files" ls $packages "$one"/umbrage-*.tar.gz "$one"/umbrage-*.whl "$one"/umbrage-*.spdx.json
for file in "$one"/*; do
    name=$(basename "$file")
    if cmp -s "$file" "$two/$name"; then
        ok "$name has the same bits"
    else
        bad "$name has the same bits" "$(cmp "$file" "$two/$name" 2>&1)"
        ! command -v diffoscope >/dev/null || diffoscope --text "$work/$name.diff" "$file" "$two/$name"
    fi
done
same "both have the same files" "$(ls "$one")" "$(ls "$two")"
check "SHA256SUMS has them" sh -c "cd '$one' && sha256sum --quiet -c SHA256SUMS && [ \$(wc -l <SHA256SUMS) -eq \$(ls *.* | wc -l) ]"
finish
