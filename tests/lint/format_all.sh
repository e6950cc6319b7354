#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Lays out all sources in a commit of its own, and lists that commit for `git blame`.
set -eu
cd "$(dirname "$0")/../.."
[ -z "$(git status --porcelain)" ] || { echo "format_all: commit first: a commit of layout holds nothing else"; exit 1; }
make format
if [ -z "$(git status --porcelain)" ]; then
    echo "format_all: every file is laid out"
    exit 0
fi
git commit -qam "format: lay out the sources by clang-format"
commit=$(git rev-parse HEAD)
git log -1 --format='# %s%n%H' >>.git-blame-ignore-revs
git commit -qm "format: name the commit of layout for git blame" .git-blame-ignore-revs
echo "format_all: $commit; git config blame.ignoreRevsFile .git-blame-ignore-revs"
