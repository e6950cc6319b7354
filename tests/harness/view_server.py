# SPDX-License-Identifier: Apache-2.0
"""`umbrage view` as a process: its address, and its end; and what its page shows."""
import array
import base64
import json
import os
import subprocess
import urllib.parse

import umbrage_test as ut


class View:
    """Serves until it is closed. program: of another folder than the build's. key: the random part of its paths."""

    def __init__(self, *words, program=None, env=None):
        self.process = subprocess.Popen([program or ut.program("umbrage"), "view", *[str(word) for word in words]],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env)
        self.address = self.process.stdout.readline().decode().strip()
        if not self.address:
            raise AssertionError(f"umbrage view {words}: {self.process.stderr.read().decode()}")
        parts = urllib.parse.urlsplit(self.address)
        self.port, self.key = parts.port, parts.path.strip("/")

    def close(self):
        self.process.terminate()
        said = self.process.communicate(timeout=20)[1]
        assert not ut.SANITIZER.search(said), said.decode(errors="replace")
        return said.decode()


class Sides:
    """Pixels of the page's picture that show a surface. points: six floats each, place and normal; shares: two floats each,
    of light by the asset and by cascades (0 if the picture is not split)."""

    def __init__(self, read):
        self.width, self.height = read["width"], read["height"]
        self.points, self.shares = (array.array("f", base64.b64decode(read[name])) for name in ("points", "shares"))


def read_sides(page, **settings):
    """settings: of the cascades."""
    with open(os.path.join(ut.ROOT, "tests", "web", "read_sides.js"), encoding="utf-8") as file:
        code = file.read()
    return Sides(page.evaluate(f"{code[code.index('(async'):].rstrip()}({json.dumps(settings)})"))
