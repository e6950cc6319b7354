#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
prose_sample.py SEED: prints 60 random comments of the sources (70 characters or more) and 24 random
paragraphs of the pages, each with its file and line. A seed always draws the same from one tree.

Read the sample as an engineer who is new to the code: docs/CONTRIBUTING.md says what to look for.
"""
import os
import random
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
COMMENTS, PARAGRAPHS = 60, 24
SHORTEST = 70  # characters
BLOCK = re.compile(r"/\*.*?\*/|(?:^[ \t]*//[^\n]*\n)+", re.DOTALL | re.MULTILINE)
STRING = re.compile(r'"(?:[^"\\\n]|\\.)*"')
PEOPLE = re.compile(r"\b(?:who|whoever|nobody|somebody)\b", re.IGNORECASE)


def files(*patterns):
    done = subprocess.run(["git", "-C", ROOT, "ls-files", "--", *patterns], check=True,
                          stdout=subprocess.PIPE)
    return done.stdout.decode().split()


def text_of(path):
    with open(os.path.join(ROOT, path), encoding="utf-8") as file:
        return file.read()


def comments():
    """(place, text as it stands, words) of every comment that is long enough"""
    for path in files(*(f"{folder}/*.{kind}" for folder in ("client", "proto", "server")
                        for kind in ("c", "h", "cc", "proto"))):
        source = text_of(path)
        bare = STRING.sub(lambda match: '"' * len(match.group()), source)
        for match in BLOCK.finditer(bare):
            text = source[match.start():match.end()]
            words = " ".join(re.sub(r"^[ \t]*(?:/\*|\*/|//|\*)?|\*/$", " ", text, flags=re.MULTILINE).split())
            if len(words) >= SHORTEST and "SPDX" not in words:
                yield f"{path}:{source.count(chr(10), 0, match.start()) + 1}", text.strip("\n"), words


def paragraphs():
    """(place, text) of every paragraph: no table, heading, code or single short line"""
    for path in files("README.md", "SECURITY.md", "docs/*.md"):
        code, begin, lines = False, 0, []
        for number, line in enumerate(text_of(path).split("\n") + [""], 1):
            fence = line.lstrip().startswith("```")
            code ^= fence
            if code or fence or not line.strip() or line.startswith(("#", "|", "![")):
                if len(" ".join(lines)) >= SHORTEST:
                    yield f"{path}:{begin}", "\n".join(lines)
                lines = []
            elif re.match(r"[-*] |\d+\. ", line) and lines:
                if len(" ".join(lines)) >= SHORTEST:
                    yield f"{path}:{begin}", "\n".join(lines)
                begin, lines = number, [line]
            else:
                begin = begin if lines else number
                lines.append(line)


def draw(seed, what, there, count):
    drawn = random.Random(f"{seed} {what}").sample(there, min(count, len(there)))
    print(f"==== {len(drawn)} of {len(there)} {what}, seed {seed}")
    for number, one in enumerate(drawn, 1):
        print(f"\n-- {number}. {one[0]}\n{one[1]}")
    print()


def main():
    seed = sys.argv[1] if len(sys.argv) == 2 else "1"
    said = list(comments())
    draw(seed, "comments", said, COMMENTS)
    draw(seed, "paragraphs", list(paragraphs()), PARAGRAPHS)
    people = [place for place, _, words in said if PEOPLE.search(words)]
    print(f"{len(people)} comments of {len(said)} say who, whoever, nobody or somebody:", *people[:20], "...")


if __name__ == "__main__":
    main()
