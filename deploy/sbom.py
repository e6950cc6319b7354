#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
sbom.py VERSION ARCHIVE OUT FILE...: writes OUT, the SPDX 2.3 bill of materials of a build, as JSON.

ARCHIVE  source archive of `make dist`
FILE     built programs and libraries

Each FILE is listed with its digests; each library that one needs is the Debian package that has it, with its version as
dpkg says and its licences as its copyright file says. Modules that the build asks pkg-config for are build dependencies.
Time is SOURCE_DATE_EPOCH or the last commit's: the same build gives the same bytes.
"""
import hashlib
import json
import os
import re
import subprocess
import sys
import time
import uuid

import elf_needs

SUPPLIER = "Organization: The umbrage project"
# pkg-config modules of the libraries that the build links or includes.
MODULES = ("libuv libnghttp2 libcurl libprotobuf-c INIReader sqlite3 openssl zlib libzstd libxxhash embree3 jansson "
           "libpng").split()
# Short names of Debian's copyright files that SPDX has under the same or another name.
LICENCES = {"expat": "MIT", "mit": "MIT", "apache-2.0": "Apache-2.0", "apache-2": "Apache-2.0", "bsd-2-clause": "BSD-2-Clause",
            "bsd-3-clause": "BSD-3-Clause", "zlib": "Zlib", "isc": "ISC", "libpng": "Libpng", "curl": "curl",
            "public-domain": None, "gpl-2": "GPL-2.0-only", "gpl-2+": "GPL-2.0-or-later", "gpl-3": "GPL-3.0-only",
            "gpl-3+": "GPL-3.0-or-later", "lgpl-2.1+": "LGPL-2.1-or-later", "cc0-1.0": "CC0-1.0"}


def digests(path):
    with open(path, "rb") as file:
        data = file.read()
    return [{"algorithm": "SHA1", "checksumValue": hashlib.sha1(data).hexdigest()},
            {"algorithm": "SHA256", "checksumValue": hashlib.sha256(data).hexdigest()}]


def spdx_id(kind, name):
    return f"SPDXRef-{kind}-" + re.sub(r"[^A-Za-z0-9.-]", "-", name)


def declared_licence(package):
    """The licence of `Files: *` in a package's copyright file, where it is one that SPDX has."""
    try:
        with open(f"/usr/share/doc/{package}/copyright", encoding="utf-8", errors="replace") as file:
            text = file.read()
    except OSError:
        return "NOASSERTION"
    for paragraph in re.split(r"\n\s*\n", text):
        if re.search(r"^Files:\s*\*\s*$", paragraph, re.MULTILINE):
            found = re.search(r"^License:[ \t]*(\S.*)$", paragraph, re.MULTILINE)
            known = [LICENCES.get(word) for word in found.group(1).strip().lower().split(" or ")] if found else [None]
            return " OR ".join(known) if all(known) else "NOASSERTION"
    return "NOASSERTION"


def installed(package):
    """Fields of an installed package as dpkg knows them."""
    words = elf_needs.output_of("dpkg-query", "-W", "-f", "${Version}\t${Architecture}\t${Maintainer}\t${Homepage}\n",
                                package).splitlines()[0].split("\t")
    return dict(zip(("version", "arch", "maintainer", "homepage"), words))


def debian_package(name):
    known = installed(name)
    person = re.match(r"(.*?)\s*<(.*)>", known["maintainer"])
    return {"SPDXID": spdx_id("Package", name), "name": name, "versionInfo": known["version"],
            "supplier": f"Organization: {person.group(1)} ({person.group(2)})" if person else "NOASSERTION",
            "downloadLocation": "NOASSERTION", "filesAnalyzed": False, "licenseConcluded": "NOASSERTION",
            "licenseDeclared": declared_licence(name), "copyrightText": "NOASSERTION",
            **({"homepage": known["homepage"]} if known["homepage"] else {}),
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl", "referenceLocator":
                              f"pkg:deb/debian/{name.replace('+', '%2B')}@{known['version'].replace('+', '%2B')}?arch={known['arch']}"}]}


def module_package(module):
    """The Debian package that has a pkg-config module, or None where the build has it not."""
    done = subprocess.run(["pkg-config", "--variable=pcfiledir", module], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          text=True, check=False)
    folder = done.stdout.strip()
    return elf_needs.package_of(os.path.join(folder, module + ".pc")) if done.returncode == 0 and folder else None


def file_entry(path):
    return {"SPDXID": spdx_id("File", os.path.basename(path)), "fileName": "./" + os.path.basename(path),
            "fileTypes": ["BINARY"], "checksums": digests(path), "licenseConcluded": "Apache-2.0",
            "licenseInfoInFiles": ["Apache-2.0"], "copyrightText": "Copyright 2026 The umbrage authors"}


def relation(one, kind, other):
    return {"spdxElementId": one, "relationshipType": kind, "relatedSpdxElement": other}


def verification_code(files):
    """SHA-1 of the sorted SHA-1s of the package's files (SPDX 2.3, 7.9)."""
    return hashlib.sha1("".join(sorted(one["checksums"][0]["checksumValue"] for one in files)).encode()).hexdigest()


def main(version, archive, out, paths):
    files = [file_entry(path) for path in sorted(paths, key=os.path.basename)]
    needs = {one["SPDXID"]: set() for one in files}
    for path in paths:
        places, ours = elf_needs.resolved(path), {os.path.basename(other) for other in paths}
        for soname in set(elf_needs.needed(path)) - ours:
            if soname not in places:
                sys.exit(f"sbom: {path}: {soname} is not installed")
            needs[spdx_id("File", os.path.basename(path))].add(elf_needs.package_of(places[soname]))
    linked = set().union(*needs.values())
    builders = {name for name in map(module_package, MODULES) if name} - linked
    product = {"SPDXID": "SPDXRef-Package-umbrage", "name": "umbrage", "versionInfo": version, "supplier": SUPPLIER,
               "originator": SUPPLIER, "downloadLocation": "NOASSERTION", "packageFileName": os.path.basename(archive),
               "checksums": digests(archive), "filesAnalyzed": True, "licenseConcluded": "Apache-2.0",
               "packageVerificationCode": {"packageVerificationCodeValue": verification_code(files)},
               "licenseInfoFromFiles": ["Apache-2.0"], "licenseDeclared": "Apache-2.0", "primaryPackagePurpose": "APPLICATION",
               "copyrightText": "Copyright 2026 The umbrage authors"}
    relations = [relation("SPDXRef-DOCUMENT", "DESCRIBES", product["SPDXID"])]
    relations += [relation(product["SPDXID"], "CONTAINS", one["SPDXID"]) for one in files]
    relations += [relation(one, "DYNAMIC_LINK", spdx_id("Package", name)) for one in sorted(needs) for name in sorted(needs[one])]
    relations += [relation(spdx_id("Package", name), "BUILD_DEPENDENCY_OF", product["SPDXID"]) for name in sorted(builders)]
    seconds = os.environ.get("SOURCE_DATE_EPOCH") or elf_needs.output_of("git", "log", "-1", "--format=%ct")
    document = {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": f"umbrage-{version}",
                "creationInfo": {"created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(int(seconds))),
                                 "creators": [SUPPLIER, f"Tool: umbrage-sbom-{version}"]},
                "packages": [product] + [debian_package(name) for name in sorted(linked | builders)], "files": files,
                "relationships": relations}
    whole = json.dumps(document, sort_keys=True).encode()
    document["documentNamespace"] = "urn:uuid:" + str(uuid.uuid5(uuid.NAMESPACE_URL, hashlib.sha256(whole).hexdigest()))
    os.makedirs(os.path.dirname(out) or ".", exist_ok=True)
    with open(out, "w", encoding="utf-8") as file:
        json.dump(document, file, indent=1, sort_keys=True)
        file.write("\n")
    print(f"{out}: {len(files)} files, {len(linked)} linked packages, {len(builders)} build dependencies")


if __name__ == "__main__":
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    main(*sys.argv[1:4], sys.argv[4:])
