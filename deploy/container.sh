#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds the container from deploy/Containerfile on a base that is named by its digest.
#
#   deploy/container.sh [DIGEST [TAG]]    DIGEST: sha256:... of docker.io/library/debian:12-slim;
#                                         "" or none: that of the Containerfile
#
# Where a newer digest comes from (it names the image for all architectures):
#   skopeo inspect --format '{{.Digest}}' docker://docker.io/library/debian:12-slim
# Take it when Debian publishes security updates. BUILDER names the program (default podman).
# Exit codes: 2 usage, 69 no builder, else the builder's.
set -eu
cd "$(dirname "$0")/.."
digest=${1:-$(sed -n 's/^ARG BASE_DIGEST=//p' deploy/Containerfile)} tag=${2-umbrage}
hex=${digest#sha256:}
case $hex in
"$digest" | *[!0-9a-f]*) hex= ;;
esac
if [ ${#hex} -ne 64 ]; then
    echo "container: BASE_DIGEST: '$digest' is not sha256: and 64 digits 0-9a-f; get it by" >&2
    echo "  skopeo inspect --format '{{.Digest}}' docker://docker.io/library/debian:12-slim" >&2
    exit 2
fi
builder=${BUILDER:-podman}
if ! command -v "$builder" >/dev/null; then
    echo "container: $builder is not installed; install it, or set BUILDER to another builder" >&2
    exit 69
fi
# The image has docker's format, because OCI images have no health checks.
set -- build --build-arg "BASE_DIGEST=$digest" --file deploy/Containerfile --tag "$tag"
[ "${builder##*/}" != podman ] || set -- "$@" --format docker
exec "$builder" "$@" .
