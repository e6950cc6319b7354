#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The bill of materials: what SPDX 2.3 requires, the digests of the files, a package for every library that is loaded, the
same bytes twice. The checker refuses the document without each of its fields.
"""
import copy
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, "..", "harness"), os.path.join(HERE, "..", "packaging")]
import sbom_check  # noqa: E402
import umbrage_test as ut  # noqa: E402

for name in ("dpkg-query", "pkg-config", "readelf", "ldd"):
    if shutil.which(name) is None:
        ut.skip(f"{name} is not installed")
test = ut.Test()
FILES = [ut.program(name) for name in ("umbrage", "umbraged", "umbrage-bake", "libumbrage-core.so.1", "libumbrage.so.1")]
ARCHIVE, SBOM = test.path("umbrage-1.2.3.tar.gz"), test.path("out", "sbom.json")
with open(ARCHIVE, "wb") as file:
    file.write(b"archive")


def make():
    subprocess.run([sys.executable, os.path.join(ut.ROOT, "deploy", "sbom.py"), "1.2.3", ARCHIVE, SBOM, *FILES], check=True,
                   cwd=ut.ROOT, stdout=subprocess.DEVNULL, env={**os.environ, "SOURCE_DATE_EPOCH": "1700000000"})
    with open(SBOM, encoding="utf-8") as text:
        return json.load(text)


document = make()

with test.check("it has every field that SPDX 2.3 requires, and says the same twice"):
    assert sbom_check.problems_of(document) == []
    assert make() == document and document["creationInfo"]["created"] == "2023-11-14T22:13:20Z"

with test.check("digests are those of the files, and every library that is loaded is of a package of the document"):
    names = {one["SPDXID"]: one for one in document["packages"] + document["files"]}
    for path in FILES:
        entry = next(one for one in document["files"] if one["fileName"] == "./" + os.path.basename(path))
        with open(path, "rb") as file:
            data = file.read()
        assert {one["algorithm"]: one["checksumValue"] for one in entry["checksums"]} == {
            "SHA1": hashlib.sha1(data).hexdigest(), "SHA256": hashlib.sha256(data).hexdigest()}
        linked = {names[one["relatedSpdxElement"]]["name"] for one in document["relationships"]
                  if one["relationshipType"] == "DYNAMIC_LINK" and one["spdxElementId"] == entry["SPDXID"]}
        # Independent of readelf: what the object file itself is told to load.
        wanted = set(re.findall(r"needed\s+lib([a-z0-9_+-]+)\.so", subprocess.run(
            ["objdump", "-p", path], stdout=subprocess.PIPE, text=True, check=True).stdout.lower())) - {"umbrage-core"}
        for library in wanted:
            stem = {"m": "c", "crypto": "ssl", "z": "zlib", "ipsec_mb": "ipsec-mb"}.get(library, library)
            assert any(stem in package for package in linked), (path, library, linked)
        assert len(linked) <= len(wanted)

with test.check("versions are those that dpkg knows"):
    for package in document["packages"][1:]:
        known = subprocess.run(["dpkg-query", "-W", "-f", "${Version}\n", package["name"]], stdout=subprocess.PIPE, text=True,
                               check=True).stdout.split()
        assert package["versionInfo"] in known and package["versionInfo"].replace("+", "%2B") in package["externalRefs"][0]["referenceLocator"]

with test.check("the checker refuses the document without any one of its required fields"):
    optional = {"homepage", "externalRefs", "originator", "packageFileName", "primaryPackagePurpose", "fileTypes", "checksums",
                "filesAnalyzed", "licenseInfoFromFiles", "packages", "files", "relationships"}
    tried = 0

    def without(path):
        changed = copy.deepcopy(document)
        owner = changed
        for step in path[:-1]:
            owner = owner[step]
        del owner[path[-1]]
        return sbom_check.problems_of(changed)

    product = document["packages"][0]
    for path in [[key] for key in document if key not in optional] + [["creationInfo", key] for key in document["creationInfo"]] + \
            [["packages", 0, key] for key in product if key not in optional] + \
            [["packages", 1, key] for key in document["packages"][1] if key not in optional] + \
            [["files", 0, key] for key in document["files"][0] if key not in optional | {"licenseInfoInFiles"}] + \
            [["files", 0, "checksums"], ["relationships", 0], ["files", 0], ["packages", 1]]:
        assert without(path), path
        tried += 1
    assert tried > 25, tried
    for path, value in ((["files", 0, "checksums", 0, "checksumValue"], "0" * 40), (["packages", 1, "licenseDeclared"], "Expat"),
                        (["files", 1, "SPDXID"], "SPDXRef_x"), (["creationInfo", "created"], "2026-13-01T00:00:00Z"),
                        (["relationships", 1, "relatedSpdxElement"], "SPDXRef-none")):
        changed = copy.deepcopy(document)
        owner = changed
        for step in path[:-1]:
            owner = owner[step]
        owner[path[-1]] = value
        assert sbom_check.problems_of(changed), path

test.finish()
