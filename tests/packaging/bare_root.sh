# SPDX-License-Identifier: Apache-2.0
# Bare Debian 12 roots for the tests of packages: sourced behind umbrage_test.sh, not run.
#
#   BARE_ROOT=FILE   tar archive of the root (default: made once by debootstrap, in BUILD/packaging)

# Ends the test as skipped where roots cannot be made.
need_bare_root() {
    reason=
    [ "$(id -u)" -eq 0 ] || reason="needs root"
    command -v debootstrap >/dev/null || reason="debootstrap is not installed"
    unshare --mount --pid --net --fork true 2>/dev/null || reason="namespaces are not allowed here"
    [ -z "$reason" ] || {
        echo "skipped: bare Debian roots: $reason"
        exit 77
    }
    archive=${BARE_ROOT:-$BUILD/packaging/bookworm.tar}
    [ -s "$archive" ] || make_bare_root "$archive"
}

# make_bare_root FILE: the smallest root that has apt, with this machine's mirrors and no compiler.
make_bare_root() {
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Codename: bookworm' | head -n 1)
    debootstrap --variant=minbase bookworm "$folder/base" "$mirror" >"$folder/debootstrap.log" 2>&1 || {
        tail -n 20 "$folder/debootstrap.log"
        echo "skipped: bare Debian roots: debootstrap got no packages"
        exit 77
    }
    for target in $(apt-get indextargets --format '$(REPO_URI),$(CODENAME)' 'Created-By: Packages' 'Component: main' |
        grep -E ',bookworm(-updates|-security)?$' | sort -u); do
        echo "deb ${target%,*} ${target#*,} main"
    done >"$folder/base/etc/apt/sources.list"
    apt-config dump | grep -i '^Acquire::.*proxy' >"$folder/base/etc/apt/apt.conf.d/90proxy"
    # No service is started in a root, and no question is asked.
    printf '#!/bin/sh\nexit 101\n' >"$folder/base/usr/sbin/policy-rc.d"
    chmod 755 "$folder/base/usr/sbin/policy-rc.d"
    chroot "$folder/base" apt-get -q update >"$folder/debootstrap.log" 2>&1
    mkdir -p "$(dirname "$1")"
    tar -C "$folder/base" -cf "$1.part" . && mv "$1.part" "$1"
    rm -rf "$folder/base"
}

# new_root NAME: makes $folder/NAME.
new_root() {
    mkdir "$folder/$1" && tar -C "$folder/$1" -xf "$archive"
}

# in_root NAME [--net]: runs the script of stdin in a root, in namespaces that end with it. Without --net its network
# is a loopback of its own.
in_root() {
    cat >"$folder/$1/script"
    [ "${2-}" = --net ] && cp -L /etc/resolv.conf "$folder/$1/etc/resolv.conf"
    unshare --mount --pid --fork --kill-child $([ "${2-}" = --net ] || echo --net) sh -ec '
        [ "$2" = --net ] || ip link set lo up
        mount -t proc proc "$1/proc"
        mount -t tmpfs tmpfs "$1/run"
        exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
            chroot "$1" sh -eu /script' sh "$folder/$1" "${2-}" >"$folder/$1.log" 2>&1
}

# page_block PAGE NAME: the commands of a page behind the comment <!-- NAME -->, without sudo and without questions.
page_block() {
    awk -v name="<!-- $2 -->" '$0 == name { found = 1; next } found && /^```/ { if (inside++) exit; next } inside' \
        "$root/$1" | sed 's/sudo //; s/apt install/apt-get install -y/'
}

# Line of a script that begins with begin=$(date +%s): adds its seconds, by the clock and of processors, to /seconds.
stop_watch='times >/times; echo $(($(date +%s) - begin)) $(awk "END { gsub(/[ms]/, \" \"); print \$1 * 60 + \$2 + \$3 * 60 + \$4 }" /times) >>/seconds'

# in_time FILE: a first answer takes at most 60 s. On a machine that is busy with other programs the clock counts
# them too; the processors' time then stands for it.
in_time() {
    wall=$(awk '{ s += $1 } END { print s }' "$1") busy=$(awk '{ s += $2 } END { print s }' "$1")
    load=$(cut -d ' ' -f 1 /proc/loadavg)
    echo "first answer after $wall s, $busy s of processors, load $load"
    if awk "BEGIN { exit !($load > $(nproc) + 1) }"; then
        left_out "60 s by the clock" "the load is $load; the processors' time is compared"
        wall=$busy
    fi
    check "it takes at most 60 s" awk "BEGIN { exit !($wall <= 60) }"
}
