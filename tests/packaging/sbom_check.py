#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
sbom_check.py FILE: is a bill of materials what SPDX 2.3 requires, field by field? Prints what is wrong, one finding a line.
The rules are written from the specification (clauses 6, 7, 8 and 11), not from the program that makes the file.
"""
import datetime
import hashlib
import json
import re
import sys

ID = re.compile(r"SPDXRef-[A-Za-z0-9.-]+$")
AGENT = re.compile(r"(Person|Organization): \S.*$")
CREATOR = re.compile(r"((Person|Organization): \S.*|Tool: \S+-\S+)$")
URI = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:[^#\s]+$")
PURL = re.compile(r"pkg:[a-z]+/[\w.%+~-]+/[\w.%+-]+@[\w.%+~:-]+(\?[\w=&.-]+)?$")
LENGTHS = {"SHA1": 40, "SHA256": 64}
RELATIONS = {"DESCRIBES", "CONTAINS", "DYNAMIC_LINK", "STATIC_LINK", "BUILD_DEPENDENCY_OF", "DEPENDS_ON", "GENERATED_FROM"}
FILE_TYPES = {"SOURCE", "BINARY", "ARCHIVE", "APPLICATION", "TEXT", "DOCUMENTATION", "SPDX", "OTHER"}
# Identifiers of the SPDX licence list that may occur here.
LICENCES = {"Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "Zlib", "ISC", "Libpng", "curl", "CC0-1.0", "GPL-2.0-only",
            "GPL-2.0-or-later", "GPL-3.0-only", "GPL-3.0-or-later", "LGPL-2.1-or-later"}


class Report:
    """Findings, each with the place of its field."""

    def __init__(self):
        self.findings = []

    def want(self, condition, place, sentence):
        if not condition:
            self.findings.append(f"{place}: {sentence}")
        return bool(condition)

    def text(self, owner, key, place, pattern=None):
        value = owner.get(key)
        good = isinstance(value, str) and value.strip() and (pattern is None or pattern.match(value))
        self.want(good, f"{place}.{key}", f"{value!r} is missing or not allowed")
        return value if isinstance(value, str) else ""

    def licence(self, owner, key, place):
        value = self.text(owner, key, place)
        words = re.split(r" (?:AND|OR) ", value)
        self.want(value in ("NOASSERTION", "NONE") or all(word in LICENCES for word in words), f"{place}.{key}",
                  f"{value!r} is no licence expression")

    def checksums(self, owner, place, required):
        found = {}
        for one in owner.get("checksums", []):
            kind, value = one.get("algorithm"), one.get("checksumValue", "")
            self.want(kind in LENGTHS and re.fullmatch(f"[0-9a-f]{{{LENGTHS.get(kind, 0)}}}", value), f"{place}.checksums",
                      f"{kind} {value!r} is not a digest")
            found[kind] = value
        self.want(set(required) <= set(found), f"{place}.checksums", f"{' and '.join(required)} are required")
        return found


def check_head(report, document):
    report.want(document.get("spdxVersion") == "SPDX-2.3", "spdxVersion", "must be SPDX-2.3")
    report.want(document.get("dataLicense") == "CC0-1.0", "dataLicense", "must be CC0-1.0")
    report.want(document.get("SPDXID") == "SPDXRef-DOCUMENT", "SPDXID", "must be SPDXRef-DOCUMENT")
    report.text(document, "name", "document")
    report.text(document, "documentNamespace", "document", URI)
    info = document.get("creationInfo", {})
    created = report.text(info, "created", "creationInfo", re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$"))
    try:
        datetime.datetime.strptime(created, "%Y-%m-%dT%H:%M:%SZ")
    except ValueError:
        report.want(False, "creationInfo.created", "no date")
    creators = info.get("creators") or []
    report.want(creators and all(CREATOR.match(str(one)) for one in creators), "creationInfo.creators", f"{creators!r}")


def check_package(report, package, place):
    for key in ("name", "versionInfo", "downloadLocation"):
        report.text(package, key, place)
    supplier = report.text(package, "supplier", place)
    report.want(supplier == "NOASSERTION" or AGENT.match(supplier), f"{place}.supplier", f"{supplier!r}")
    report.licence(package, "licenseConcluded", place)
    report.licence(package, "licenseDeclared", place)
    report.text(package, "copyrightText", place)
    analysed = package.get("filesAnalyzed", True)
    report.want(isinstance(analysed, bool), f"{place}.filesAnalyzed", "must be true or false")
    code = package.get("packageVerificationCode", {}).get("packageVerificationCodeValue", "")
    report.want(not analysed or re.fullmatch("[0-9a-f]{40}", code), f"{place}.packageVerificationCode",
                "is required where files are analysed")
    for one in package.get("externalRefs", []):
        report.want(one.get("referenceCategory") in ("PACKAGE-MANAGER", "SECURITY", "OTHER"), f"{place}.externalRefs", "category")
        report.want(one.get("referenceType") != "purl" or PURL.match(one.get("referenceLocator", "")), f"{place}.externalRefs",
                    f"{one.get('referenceLocator')!r} is no package URL")
    report.checksums(package, place, ())


def check_file(report, file, place):
    name = report.text(file, "fileName", place, re.compile(r"\./\S"))
    report.want(".." not in name, f"{place}.fileName", "leaves the package")
    report.want(set(file.get("fileTypes", [])) <= FILE_TYPES, f"{place}.fileTypes", f"{file.get('fileTypes')!r}")
    report.licence(file, "licenseConcluded", place)
    for one in file.get("licenseInfoInFiles") or [""]:
        report.want(one in LICENCES | {"NOASSERTION", "NONE"}, f"{place}.licenseInfoInFiles", f"{one!r}")
    report.text(file, "copyrightText", place)
    return report.checksums(file, place, ("SHA1",)).get("SHA1", "")


def problems_of(document):
    """What is wrong with a document, a sentence each."""
    report = Report()
    check_head(report, document)
    packages, files = document.get("packages", []), document.get("files", [])
    ids = ["SPDXRef-DOCUMENT"]
    for number, package in enumerate(packages):
        ids.append(report.text(package, "SPDXID", f"packages[{number}]", ID))
        check_package(report, package, f"packages[{number}]")
    sha1 = {}
    for number, file in enumerate(files):
        ids.append(report.text(file, "SPDXID", f"files[{number}]", ID))
        sha1[ids[-1]] = check_file(report, file, f"files[{number}]")
    report.want(len(set(ids)) == len(ids), "SPDXID", "an identifier is there twice")
    contained, described = {}, set()
    for number, one in enumerate(document.get("relationships", [])):
        left, kind, right = one.get("spdxElementId"), one.get("relationshipType"), one.get("relatedSpdxElement")
        report.want(kind in RELATIONS, f"relationships[{number}]", f"{kind!r}")
        report.want(left in ids and right in ids, f"relationships[{number}]", f"{left} {kind} {right}: no such element")
        contained.setdefault(left, []).append(right) if kind == "CONTAINS" else None
        described.add(right) if kind == "DESCRIBES" and left == "SPDXRef-DOCUMENT" else None
    report.want(described or len(packages) == 1, "relationships", "the document describes nothing")
    for number, package in enumerate(packages):
        if package.get("filesAnalyzed", True):
            of = sorted(sha1.get(one, "") for one in contained.get(package.get("SPDXID"), []))
            wanted = hashlib.sha1("".join(of).encode()).hexdigest()
            report.want(package.get("packageVerificationCode", {}).get("packageVerificationCodeValue") == wanted,
                        f"packages[{number}].packageVerificationCode", f"is not {wanted}, that of its files")
    return report.findings


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as text:
        found = problems_of(json.load(text))
    print("\n".join(found) or "ok")
    sys.exit(1 if found else 0)
