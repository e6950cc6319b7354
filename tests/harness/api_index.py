# SPDX-License-Identifier: Apache-2.0
"""The functions of docs/reference/api.md: `api_index.py` fails where the page and the installed headers
differ, `api_index.py --write` puts the headers' functions into the page. The text in a header's row is
written by hand. A header without a row gets one with an empty text, which is a failure until it is
filled in."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "reference" / "api.md"
HEADERS = ROOT / "client" / "include" / "umbrage"
ROW = re.compile(r"^\| \[`umbrage/(\w+\.h)`\]\([^)]*\) \| (.*?) \| .*\|$", re.M)


def functions(header):
    """Names that a header declares with UMB_API, in its order."""
    text = re.sub(r"/\*.*?\*/", "", header.read_text(encoding="utf-8"), flags=re.S)
    text = re.sub(r"^#.*$", "", text, flags=re.M)
    return re.findall(r"\bUMB_API\b[^;{]*?\b(umb_\w+)\s*\(", text)


def row(header, purpose):
    names = ", ".join(f"`{name}`" for name in functions(header)) or "types only"
    return f"| [`umbrage/{header.name}`](../../client/include/umbrage/{header.name}) | {purpose} | {names} |"


def main():
    page = PAGE.read_text(encoding="utf-8")
    known = {match[1]: match for match in ROW.finditer(page)}
    headers = {header.name: header for header in sorted(HEADERS.glob("*.h"))}
    wanted, failed = page, 0
    for name, match in known.items():
        if name in headers:
            wanted = wanted.replace(match[0], row(headers[name], match[2]))
        else:
            wanted = wanted.replace(match[0] + "\n", "")
    new = [row(headers[name], "") for name in headers if name not in known]
    if new:
        wanted = wanted.rstrip("\n") + "\n\n| header | purpose | functions |\n|---|---|---|\n" + "\n".join(new) + "\n"
    if "--write" in sys.argv[1:]:
        PAGE.write_text(wanted, encoding="utf-8")
    elif wanted != page:
        print("docs/reference/api.md differs from the headers: run tests/harness/api_index.py --write")
        failed = 1
    for name in re.findall(r"^\| \[`umbrage/(\w+\.h)`\]\([^)]*\) \|  \|", wanted, re.M):
        print(f"docs/reference/api.md: umbrage/{name} has no purpose: write one")
        failed = 1
    return failed


if __name__ == "__main__":
    sys.exit(main())
