# SPDX-License-Identifier: Apache-2.0
"""
What ELF files need: libraries by readelf and ldd, versions of glibc's symbols, and the Debian packages of files by dpkg.
"""
import functools
import os
import re
import subprocess
import sys


def output_of(*words):
    """Standard output of a program; ends this one with its name where it is missing or fails."""
    try:
        done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False,
                              env={**os.environ, "LC_ALL": "C"})
    except FileNotFoundError:
        sys.exit(f"{words[0]} is not installed")
    if done.returncode != 0:
        sys.exit(f"{' '.join(words)}: {done.stderr.strip()}")
    return done.stdout


def needed(path):
    """Sonames in the DT_NEEDED entries of a file."""
    return re.findall(r"\(NEEDED\).*\[(.*)\]", output_of("readelf", "-dW", path))


def resolved(path):
    """{soname: path} of all libraries that a file is loaded with."""
    told = output_of("ldd", path)
    loader = re.findall(r"^\s*(/\S+/(\S+)) \(", told, re.MULTILINE)
    return dict(re.findall(r"^\s*(\S+) => (/\S+)", told, re.MULTILINE) + [(name, place) for place, name in loader])


def symbol_versions(path):
    """Versions of symbols that a file needs of others, as GLIBC_2.34."""
    sections = output_of("readelf", "-VW", path)
    begin = sections.find("Version needs section")
    return set(re.findall(r"Name: (\S+)", sections[begin:])) if begin >= 0 else set()


@functools.lru_cache(maxsize=None)
def package_of(path):
    """Name of the Debian package of a file, without its architecture."""
    real = os.path.realpath(path)
    for name in (real, real.removeprefix("/usr"), path):
        done = subprocess.run(["dpkg-query", "-S", name], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                              check=False)
        if done.returncode == 0:
            return done.stdout.partition(":")[0]
    return sys.exit(f"{path}: no Debian package has it")
