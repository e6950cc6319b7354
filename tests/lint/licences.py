#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Prints what is wrong with the licences of the tree, one finding a line: a source without an SPDX line of its own, a kind of
file that this list does not know, a licence without its text in LICENSES/ or a text without use, copyright that no rule
of .reuse/dep5 gives, a package's copyright file that says otherwise. `reuse lint` (where installed) looks for the same.
"""
import fnmatch
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
# Files that hold a comment in their first lines.
SOURCES = re.compile(r"\.(c|h|cc|py|sh|mk|js|proto|yml|yaml|toml|obj|awk|cfg|socket|tsv\.in|service\.in|postrm)$|(^|/)(Makefile|Containerfile|rules)$")
# Files that have none: prose, data, pictures, lists that programs read line by line.
DATA = re.compile(r"\.(md|txt|png|json|html|tsv|dict|in|typed|conf|sysusers|tmpfiles|install|links|symbols|lintian-overrides|umb|umbm|bin|glb)$|"
                  r"^tests/(fuzz/(seeds|regress)|compat)/|^deploy/debian/(control|copyright)$|^(LICENSE|LICENSES/.*|\.reuse/dep5)$|"
                  r"^\.(clang-format|clang-tidy|dockerignore|editorconfig|git[a-z-]+)$")
MARK = re.compile(r"SPDX-License-Identifier[:] ([A-Za-z0-9.+-]+)")


def read(name):
    with open(os.path.join(ROOT, name), encoding="utf-8", errors="replace") as file:
        return file.read()


def rules(text):
    """[(patterns, copyright, licence)] of a file in Debian's copyright format."""
    found = []
    for paragraph in re.split(r"\n\s*\n", text):
        fields = dict(re.findall(r"^([A-Za-z-]+): *(.*(?:\n .*)*)", paragraph, re.MULTILINE))
        if "Files" in fields:
            found.append((fields["Files"].split(), fields.get("Copyright", "").strip(),
                          fields.get("License", "").split("\n")[0].strip()))
    return found


def licences_of(name):
    """Licences that the first lines of a file name."""
    with open(os.path.join(ROOT, name), "rb") as file:
        return set(MARK.findall(file.read(600).decode("utf-8", "replace")))


def problems(names):
    used = set()
    table = rules(read(".reuse/dep5"))
    for name in names:
        own = licences_of(name) if not os.path.islink(os.path.join(ROOT, name)) else set()
        used |= own
        if SOURCES.search(name) and not own:
            yield f"{name}: no line SPDX-License-Identifier"
        elif not SOURCES.search(name) and not DATA.search(name) and not own:
            yield f"{name}: a kind of file without a rule: give it an SPDX line, or name its kind in tests/lint/licences.py"
        covers = [rule for rule in table if any(fnmatch.fnmatch(name, pattern) for pattern in rule[0])]
        if not covers or not covers[-1][1] or not covers[-1][2]:
            yield f"{name}: .reuse/dep5 gives it no copyright or no licence"
        else:
            used.add(covers[-1][2])
    texts = {os.path.splitext(name)[0] for name in os.listdir(os.path.join(ROOT, "LICENSES"))}
    for name in sorted(used ^ texts):
        yield f"{name}: {'its text is not in LICENSES' if name in used else 'nothing in the tree has this licence'}"
    if read("LICENSE") != read("LICENSES/Apache-2.0.txt"):
        yield "LICENSE and LICENSES/Apache-2.0.txt differ"
    packaged = {(copyright_, licence) for _, copyright_, licence in rules(read("deploy/debian/copyright"))}
    if packaged != {(copyright_, licence) for _, copyright_, licence in table}:
        yield "deploy/debian/copyright says otherwise than .reuse/dep5"


if __name__ == "__main__":
    listed = subprocess.run(["git", "-C", ROOT, "ls-files", "-z"], stdout=subprocess.PIPE, check=True, text=True).stdout
    found = list(problems([name for name in listed.split("\0") if name and os.path.lexists(os.path.join(ROOT, name))]))
    print("\n".join(found)) if found else None
    sys.exit(1 if found else 0)
