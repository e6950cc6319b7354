# SPDX-License-Identifier: Apache-2.0
"""`umbrage view` as a process: its address, and its end."""
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
