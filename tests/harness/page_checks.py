# SPDX-License-Identifier: Apache-2.0
"""Prints what is wrong with the pages, one finding a line: a relative link that leads to no file or to
no heading, a page named in a source that does not exist, a file named in a page that is not in the
tree, a line of prose over 100 columns, a page that is too long. The argument is the repository's
root."""

import fnmatch
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(sys.argv[1]).resolve()
WORDS = {"README.md": 900, "docs/reference/umb-format.md": 7000, "docs/reference/operations.md": 10000}
WORDS_OF_OTHERS = 3000
COLUMNS = 100


def files(*patterns):
    found = subprocess.run(["git", "-C", root, "ls-files", "-co", "--exclude-standard", *patterns],
                           capture_output=True, text=True, check=True).stdout.split()
    return [root / name for name in found if (root / name).is_file()]


def prose(page):
    """A page without its code blocks."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)


def anchors(page):
    """The names that a forge gives a page's headings: the second of one name ends in -1."""
    names = {}
    for heading in re.findall(r"^#+ +(.+?) *$", prose(page), re.M):
        text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = re.sub(r"[^\w\- ]", "", text).replace(" ", "-")
        count = names[name] = names.get(name, -1) + 1
        if count:
            names[f"{name}-{count}"] = 0
    return names


pages = files("*.md")
assert len(pages) > 20, pages
for page in pages:
    name = str(page.relative_to(root))
    words = len(page.read_text(encoding="utf-8").split())
    if words > WORDS.get(name, WORDS_OF_OTHERS):
        print(f"{name}: {words} words, at most {WORDS.get(name, WORDS_OF_OTHERS)}")
    for line in prose(page).split("\n"):
        # A table's row is one line; indented code, pictures and long words cannot be wrapped.
        if len(line) > COLUMNS and " " in line[:COLUMNS] and not line.startswith(("|", "    ", "!")):
            print(f"{name}: over {COLUMNS} columns: {line[:60]}")
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or root not in target.parents:
            print(f"{name}: {link}: no such file")
        elif anchor and anchor not in anchors(target):
            print(f"{name}: {link}: no such heading")
tree = [str(file.relative_to(root)) for file in files()]
for page in pages:
    for named in set(re.findall(r"`([\w./*-]+)`", prose(page))):
        # A path of the tree, or the name of a source alone; * stands for any characters.
        if re.match(r"(?:client|proto|server|tests|deploy)/", named):
            there = fnmatch.filter(tree, named.rstrip("/")) or fnmatch.filter(tree, named.rstrip("/") + "[/.]*")
        elif re.fullmatch(r"[\w*]+\.(?:c|h|cc|py|sh|mk|toml|proto)", named):
            there = fnmatch.filter(tree, "*/" + named)
        else:
            continue
        if not there:
            print(f"{page.relative_to(root)}: no {named} in the tree")
for source in files():
    if source.suffix in (".png", ".gz") or "fuzz" in source.parts:
        continue
    text = source.read_text(encoding="utf-8", errors="replace")
    for named in set(re.findall(r"(?<![\w/.-])docs/[\w./-]+\.(?:md|png)", text)):
        if not (root / named).exists():
            print(f"{source.relative_to(root)}: {named} does not exist")
