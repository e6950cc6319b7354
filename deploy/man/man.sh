#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes a man page of its template: a line `@help COMMAND...@` becomes what that command prints, so
# that a page never says anything else than --help. BUILD: where the programs are. stdin, stdout.
set -eu

# Text as roff shows it unchanged.
verbatim() {
    echo '.nf'
    sed -e 's/\\/\\e/g; s/-/\\-/g; s/^\([.'"'"']\)/\\\&\1/'
    echo '.fi'
}

while IFS= read -r line; do
    case $line in
    @help\ *@)
        words=${line#@help }
        words=${words%@}
        # Split on purpose: a program and its arguments.
        # shellcheck disable=SC2086
        "$BUILD"/$words | verbatim
        ;;
    *) printf '%s\n' "$line" ;;
    esac
done
