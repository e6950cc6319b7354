#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# deb.sh VERSION: builds the Debian packages of the archive that `make dist` made. Their files have the time of the last
# commit and nothing of the caller's settings, so the same commit gives the same bytes. Exit codes: 1 a failed build, 69 a
# program is missing.
set -eu
umask 022
version=$1
for program in dpkg-buildpackage dh dh_python3; do
    command -v "$program" >/dev/null || { echo "deb: $program is missing: install debhelper and dh-python" >&2; exit 69; }
done
archive=$(realpath "$BUILD/dist/umbrage-$version.tar.gz")
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
LC_ALL=C.UTF-8 TZ=UTC
export SOURCE_DATE_EPOCH LC_ALL TZ
rm -rf "$BUILD/deb"
mkdir -p "$BUILD/deb"
cd "$BUILD/deb"
tar xf "$archive"
cd "umbrage-$version"
cp -r deploy/debian debian
cat >debian/changelog <<END
umbrage ($version-1) unstable; urgency=medium

  * docs/CHANGELOG.md in umbrage-doc lists the changes.

 -- $(sed -n "s/^Maintainer: //p" debian/control)  $(LC_ALL=C date -u -R -d "@$SOURCE_DATE_EPOCH")
END
unset BUILD MAKEFLAGS MAKEOVERRIDES MAKELEVEL CC CXX CFLAGS LDFLAGS PREFIX DESTDIR config werror
dpkg-buildpackage -b -us -uc >../build.log 2>&1 || { tail -n 40 ../build.log >&2; exit 1; }
cd ..
ls -1 ./*.deb
