#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
version.py VERSION [DATE]: sets the version of the tree. DATE is that of the changelog, YYYY-MM-DD (default: today).

umbrage/version.h is the place of the version; the other files follow from it:

    client/include/umbrage/version.h   the three numbers: programs, libraries, packages, wheel and archive take it from here
    docs/CHANGELOG.md                  the part "(unreleased)" gets the version and the date
    deploy/debian/libumbrage1.symbols  functions that the last tag lacks are from this version on
    docs/results                       pages that name a version without a tag mean the one that is being made
"""
import datetime
import glob
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
HEADER = os.path.join("client", "include", "umbrage", "version.h")
CHANGELOG = os.path.join("docs", "CHANGELOG.md")
SYMBOLS = os.path.join("deploy", "debian", "libumbrage1.symbols")
PARTS = ("MAJOR", "MINOR", "PATCH")


def fail(sentence):
    sys.exit(f"version: {sentence}")


def git(*words):
    """Output of git, or "" where it fails: a tree without its history has no tags."""
    done = subprocess.run(["git", "-C", ROOT, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    return done.stdout if done.returncode == 0 else ""


def read(name):
    with open(os.path.join(ROOT, name), encoding="utf-8") as file:
        return file.read()


def header_version(text):
    return ".".join(re.search(rf"^#define UMB_VERSION_{part} (\d+)$", text, re.M).group(1) for part in PARTS)


def with_version(header, version):
    """The header's text with the three numbers of a version."""
    for part, number in zip(PARTS, version.split(".")):
        header = re.sub(rf"^(#define UMB_VERSION_{part}) \d+$", rf"\1 {number}", header, flags=re.M)
    return header


def renamed(text, old, new):
    """A text that names the version `new` where it named `old`, but not in longer numbers."""
    return re.sub(rf"(?<![\d.]){re.escape(old)}(?!\.?\d)", new, text)


def with_symbols(text, tagged, version):
    """The list of symbols in which those that the tag's list lacks have a version."""
    known = {line.split()[0]: line.split()[1] for line in tagged.splitlines() if "@" in line}
    line_of = re.compile(r"^ (\S+@\S+) \S+$", re.M)
    return line_of.sub(lambda found: f" {found.group(1)} {known.get(found.group(1), version)}", text)


def changes(version, date):
    """{file: its new text}"""
    header, changelog = read(HEADER), read(CHANGELOG)
    old, tags = header_version(header), git("tag", "--list", "v[0-9]*", "--sort=version:refname").split()
    if "v" + version in tags:
        fail(f"VERSION: {version} is tagged already; give a later one")
    heading = re.search(r"^## (\S+) (.*)$", changelog, re.M)
    if not heading or heading.group(2) != "(unreleased)":
        fail(f"{CHANGELOG}: the first part is not '## VERSION (unreleased)'; give the changes since the last release such a part")
    changelog = changelog.replace(heading.group(0), f"## {version} ({date})", 1)
    tagged = git("show", f"{tags[-1]}:{SYMBOLS}") if tags else ""
    texts = {HEADER: with_version(header, version), CHANGELOG: changelog, SYMBOLS: with_symbols(read(SYMBOLS), tagged, version)}
    for name in {old, heading.group(1)} - {tag[1:] for tag in tags}:
        texts[CHANGELOG] = renamed(texts[CHANGELOG], name, version)
        for path in sorted(glob.glob(os.path.join(ROOT, "docs", "results", "*.md"))):
            page = os.path.relpath(path, ROOT)
            texts[page] = renamed(texts.get(page) or read(page), name, version)
    return texts


def main(version, date):
    if not re.fullmatch(r"(0|[1-9]\d*)(\.(0|[1-9]\d?)){2}", version):
        fail(f"VERSION: '{version}' is not MAJOR.MINOR.PATCH, each without a leading 0, MINOR and PATCH up to 99")
    try:
        datetime.date.fromisoformat(date)
    except ValueError:
        fail(f"DATE: '{date}' is not a day as 2026-01-31")
    for name, text in changes(version, date).items():
        if text != read(name):
            with open(os.path.join(ROOT, name), "w", encoding="utf-8") as file:
                file.write(text)
            print(name)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2] if len(sys.argv) == 3 else datetime.date.today().isoformat())
