#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the Debian 12 packages that umbrage needs and that are missing; touches nothing else.
#
#   deploy/deps.sh            what building and testing need
#   deploy/deps.sh --view     also what `umbrage view` needs
#   deploy/deps.sh --full     also what only some tests, benchmarks and checks use
#   deploy/deps.sh --check    install nothing; exit 1 and name what is missing
#
# Needs root, or sudo. apt-get runs only if something is missing. Exit codes: 0 ok, 1 missing
# (--check), 2 usage, 69 not Debian, 74 apt-get failed, 77 neither root nor sudo.
set -eu

needed="
    gcc g++ libc6-dev make pkg-config
    libuv1-dev libnghttp2-dev libcurl4-openssl-dev
    libprotobuf-c-dev protobuf-c-compiler protobuf-compiler
    libinih-dev libsqlite3-dev libssl-dev zlib1g-dev libzstd-dev libxxhash-dev
    libembree-dev libjansson-dev libpng-dev
    libcmocka-dev python3 python3-grpcio python3-protobuf python3-cffi python3-numpy
"
# libipsec-mb exists for x86-64 only; without it pages are hashed one by one.
if [ "$(dpkg --print-architecture 2>/dev/null)" = amd64 ]; then
    needed="$needed libipsec-mb-dev"
fi
viewer="clang lld wasi-libc libclang-rt-dev-wasm32 libjs-three"
optional="
    $viewer clang-tidy clang-format valgrind abigail-tools
    nodejs node-typescript
    chromium glslang-tools libvulkan-dev mesa-vulkan-drivers haproxy nginx libgrpc++-dev libprotobuf-dev protobuf-compiler-grpc libnanovdb-dev slurm-wlm prometheus
    debhelper dh-python debootstrap faketime locales reuse lintian python3-yaml python3-matplotlib python3-pip mypy
"

usage() {
    echo "usage: deploy/deps.sh [--full] [--view] [--check]"
}

say() {
    echo "deps: $*"
}

# Is the package installed and configured?
has() {
    dpkg-query -W -f='${db:Status-Abbrev}' "$1" 2>/dev/null | grep -q '^[ih]i '
}

# Prints the packages of the arguments that are missing, each after a space.
missing_of() {
    for package in "$@"; do
        has "$package" || printf ' %s' "$package"
    done
}

# Runs a command as root, without questions from package scripts.
as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        env DEBIAN_FRONTEND=noninteractive "$@"
    else
        sudo env DEBIAN_FRONTEND=noninteractive "$@"
    fi
}

full=0
check=0
for argument in "$@"; do
    case $argument in
    --full) full=1 ;;
    --view) needed="$needed $viewer" ;;
    --check) check=1 ;;
    --help)
        usage
        exit 0
        ;;
    *)
        usage >&2
        exit 2
        ;;
    esac
done

# The lists are without quotes on purpose, here and below: the shell splits them into one word a
# package.
# shellcheck disable=SC2086
if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    say "this is not a Debian system; install the counterparts of:" $needed >&2
    exit 69
fi

# shellcheck disable=SC2086
missing_needed=$(missing_of $needed)
missing_optional=""
if [ "$full" -eq 1 ]; then
    # shellcheck disable=SC2086
    missing_optional=$(missing_of $optional)
fi
missing=$missing_needed$missing_optional

if [ -z "$missing" ]; then
    say "nothing is missing"
    exit 0
fi
if [ "$check" -eq 1 ]; then
    say "missing:$missing" >&2
    exit 1
fi
if [ "$(id -u)" -ne 0 ] && ! command -v sudo >/dev/null; then
    say "missing:$missing" >&2
    say "installing them needs root, and there is no sudo; run as root: apt-get install$missing" >&2
    exit 77
fi

say "installing:$missing"
# A fresh machine may have no package lists, and an old machine outdated ones.
if ! as_root apt-get -q update; then
    say "apt-get update failed; trying with the package lists that are there" >&2
fi
if [ -n "$missing_needed" ]; then
    # shellcheck disable=SC2086
    if ! as_root apt-get -q install -y --no-install-recommends $missing_needed; then
        say "apt-get install failed" >&2
    fi
fi
# Optional packages are installed one by one, so that one that is not available does not prevent the
# others.
for package in $missing_optional; do
    if ! as_root apt-get -q install -y --no-install-recommends "$package"; then
        say "apt-get install $package failed" >&2
    fi
done

# shellcheck disable=SC2086
missing=$(missing_of $missing)
if [ -n "$missing" ]; then
    say "still missing:$missing" >&2
    exit 74
fi
say "done"
