#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Proves the include rules of docs/ARCHITECTURE.md: who may include whom, and who may see which library.
#
# core <- wire <- {rpc, daemon};  core <- common <- {scene, store};  scene <- {rays, bake, study};  {store, jobs} <- daemon;
# rays <- {bake, study};  rpc <- {cli, load, study};  cli <- load. Nothing under client/ or proto/ includes server/.
set -eu
cd "$(dirname "$0")/../.."
failures=0

fail() {
    echo "layers: $1"
    failures=$((failures + 1))
}

includes() { # folder: every "path" include in it, as file:path
    grep -rnoE '^[[:space:]]*#[[:space:]]*include[[:space:]]*["<][^">]+[">]' "$1" --include='*.c' --include='*.h' |
        sed -E 's/:[0-9]+:[^"<]*["<]/ /; s/[">]$//'
}

# forbid FOLDER REGEX WHY: no include of FOLDER matches REGEX
forbid() {
    [ -d "$1" ] || return 0
    found=$(includes "$1" | awk -v pattern="$2" '$2 ~ pattern { print "  " $1 " includes " $2 }')
    [ -z "$found" ] || fail "$1 $3:
$found"
}

EMBREE='^embree3/'
ASSIMP='^assimp/'
LIBUV='^uv\.h'
HTTP2='^nghttp2/'
PROTOBUF='(pb-c\.h$|^protobuf-c/)'
SERVER='^(common|scene|store|daemon|jobs|bake|rays|study|analysis|build|depth|import|sandbox|tiles|write)/'

forbid client/include "^(format|query|base|curve|maps|partial|wire|rpc|cli|load)/|$SERVER" "is public and sees only itself"
forbid client/core "$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^(wire|rpc|cli|load)/|^openssl/|$SERVER" "sees libc, libm, xxHash and zstd only"
forbid client/rpc "$EMBREE|$ASSIMP|$PROTOBUF|^(cli|load)/|$SERVER" "uses the core and wire, libuv and nghttp2"
forbid client/cli "$EMBREE|$ASSIMP|$PROTOBUF|$HTTP2|$LIBUV|^load/|$SERVER" "uses the public headers and the toolbox"
forbid client/cli '^(\.\./|(base|format|query|curve|maps|partial|rpc|wire|net)/)' "is the first customer: umbrage/, cli/ and tool/"
# The load test is a command of the same program: it shares the CLI's session, points, output and JSON.
forbid client/load "$EMBREE|$ASSIMP|$PROTOBUF|$HTTP2|$LIBUV|$SERVER" "uses the core, libumbrage and what commands share"
others=$(includes client/load | awk '$2 ~ /^cli\// && $2 !~ /^cli\/cli_(json|output|points|session)\.h$/ { print "  " $1 " includes " $2 }')
[ -z "$others" ] || fail "client/load sees only what the CLI's commands share:
$others"
forbid proto/wire "$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$SERVER|^rpc_" "uses the core, protobuf-c and zlib"
forbid proto/net "$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^(wire|rpc)/|$SERVER" "uses the core and OpenSSL, and does no I/O"
OUTER='^(jobs|daemon|bake|rays|study)/'
forbid server/common "^(scene|store)/|$OUTER|$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^wire/" "uses the core only"
forbid server/scene "^store/|$OUTER|$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^wire/" "uses core and common"
forbid server/store "^scene/|$OUTER|$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^wire/" "uses core and common"
# Of scenes the job service knows the magic of scene files alone: bundles may not be such.
others=$(includes server/jobs | awk '$2 ~ /^scene\// && $2 != "scene/scene_file.h" { print "  " $1 " includes " $2 }')
[ -z "$others" ] || fail "server/jobs sees of scenes scene_file.h only:
$others"
forbid server/jobs "^store/|$EMBREE|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^wire/|^(daemon|bake|rays|study)/" "uses core and common, and SQLite"
forbid server/daemon "$EMBREE|$ASSIMP|$PROTOBUF|^(scene|bake|rays|study)/" "uses core, wire, common, store and jobs"
forbid server/rays "^(store|jobs)/|$ASSIMP|$LIBUV|$HTTP2|$PROTOBUF|^wire/|^(daemon|bake|study)/" "uses core, common and scene, and Embree"
forbid server/bake "^sqlite3\.h|^(store|jobs)/|$LIBUV|$HTTP2|$PROTOBUF|^wire/|^(daemon|study)/" "uses core, common, scene and rays"
forbid server/study "^(store|jobs)/|$ASSIMP|$HTTP2|$PROTOBUF|$LIBUV|^(daemon|bake)/" "uses core, common, scene, rays and libumbrage"

# libcurl: ranges over HTTP for the command alone.
others=$(grep -rlE '# *include <curl/' server client proto --include='*.c' --include='*.h' |
    grep -v '^client/cli/' || true)
[ -z "$others" ] || fail "only client/cli sees libcurl: $others"

# libipsec-mb: one file of common.
others=$(grep -rlE '# *include <intel-ipsec-mb' server client proto --include='*.c' --include='*.h' |
    grep -v '^server/common/sha256_lanes\.c$' || true)
[ -z "$others" ] || fail "only server/common/sha256_lanes.c sees libipsec-mb: $others"

# Assimp: the sandboxed importer alone. Embree: rays, and the bake's candidate path.
others=$(includes server/bake | awk -v pattern="$ASSIMP" '$2 ~ pattern && $1 !~ /^server\/bake\/import\// { print "  " $1 }')
[ -z "$others" ] || fail "only server/bake/import sees Assimp:
$others"
others=$(grep -rlE 'rtc(New|Intersect|Occluded)' server client proto --include='*.c' --include='*.h' |
    grep -vE '^server/(rays|bake/depth)/' || true)
[ -z "$others" ] || fail "only server/rays and server/bake/depth call Embree:
  $others"

# protobuf-c's generated code: only proto/wire.
others=$(grep -rlE 'pb-c\.h' client server --include='*.c' --include='*.h' || true)
[ -z "$others" ] || fail "only proto/wire sees generated code: $others"

# Public headers compile as C99 and as C++11.
for header in client/include/umbrage/*.h; do
    for mode in "-x c -std=c99" "-x c++ -std=c++11"; do
        # shellcheck disable=SC2086
        ${CC:-cc} $mode -Wall -Wextra -Werror -pedantic -fsyntax-only -Iclient/include "$header" ||
            fail "$header does not compile with $mode"
    done
done

[ "$failures" -eq 0 ] && echo "layers: ok"
exit "$failures"
