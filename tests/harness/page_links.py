# SPDX-License-Identifier: Apache-2.0
"""Prints each relative link of a page that leads to no file or to no heading, and each page named in a
source that does not exist. The argument is the root of the repository."""

import pathlib
import re
import subprocess
import sys

root = pathlib.Path(sys.argv[1]).resolve()


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
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or root not in target.parents:
            print(f"{page.relative_to(root)}: {link}: no such file")
        elif anchor and anchor not in anchors(target):
            print(f"{page.relative_to(root)}: {link}: no such heading")
for source in files():
    if source.suffix in (".png", ".gz") or "fuzz" in source.parts:
        continue
    text = source.read_text(encoding="utf-8", errors="replace")
    for name in set(re.findall(r"(?<![\w/.-])docs/[\w./-]+\.(?:md|png)", text)):
        if not (root / name).exists():
            print(f"{source.relative_to(root)}: {name} does not exist")
