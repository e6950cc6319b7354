#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes a man page (stdout) from its template (stdin). A line `@help COMMAND...@` is replaced by the
# output of that command, with its options as tagged paragraphs, so that page and --help always
# agree. BUILD: folder of the programs.
set -eu

# Converts help texts to roff: text is shown unchanged; options (two blanks, a name, the help from
# column 27 on) become .TP.
roff() {
    awk '
        function escaped(text) {
            gsub(/\\/, "\\e", text)
            gsub(/-/, "\\-", text)
            sub(/^[.\047]/, "\\\\\\&&", text)
            return text
        }
        function mode(wanted) { # verbatim lines stand between .nf and .fi
            if (wanted != verbatim) print (wanted ? ".nf" : ".fi")
            verbatim = wanted
        }
        /^[a-z][a-z ]*:$/ && blank && $0 != "commands:" { mode(0); print ".SS " escaped(substr($0, 1, length($0) - 1)); in_options = 1; next }
        in_options && /^  (-[a-z], )?-?-?[A-Za-z]/ {
            left = $0
            rest = ""
            if (length($0) > 26 && substr($0, 25, 2) == "  ") {
                left = substr($0, 1, 26)
                rest = substr($0, 27)
            }
            sub(/^ +/, "", left)
            sub(/ +$/, "", left)
            print ".TP\n.B " escaped(left)
            if (rest != "") print escaped(rest)
            next
        }
        in_options && /^                          / { print escaped(substr($0, 27)); next }
        { blank = $0 == "" }
        in_options && blank { next }
        { if (in_options) { print ".PP"; in_options = 0 } mode(1); print escaped($0) }
        END { mode(0) }'
}

while IFS= read -r line; do
    case $line in
    @help\ *@)
        words=${line#@help }
        words=${words%@}
        # Without quotes on purpose: the shell splits the words into a program and its arguments.
        # shellcheck disable=SC2086
        "$BUILD"/$words | roff
        ;;
    *) printf '%s\n' "$line" ;;
    esac
done
