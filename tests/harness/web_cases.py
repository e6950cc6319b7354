# SPDX-License-Identifier: Apache-2.0
"""
Cases of tests/web/suite.mjs: assets of several scenes, points, and the answers of `umbrage query`.
"""
import gzip
import http.server
import json
import os
import random
import re
import shutil
import subprocess
import threading

import forged_pages
import link
import umbrage_test as ut

PACKAGE = os.path.join(ut.BUILD, "web", "umbrage")
POINTS = int(os.environ.get("UMBRAGE_POINTS", "65536"))
STREET = {"eye": [1, 1.7, 1], "target": [100, 1.7, 9], "fov_y": 1.047, "aspect": 1.778, "far_m": 150}
# Scene, size of its generator, options of the bake, and the camera of the points.
SCENES = {
    "city": (24, ["--resolution", 4096, "--sun", "135,45"], "eye=1,1.7,1,target=100,1.7,9,fov=60"),
    "terrain": (512, ["--resolution", 2048, "--closed", "off"], "az=40,el=30"),
    "bridge": (30, ["--resolution", 2048], "az=200,el=20"),
    "forest": (60, ["--resolution", 2048], "az=100,el=25"),
    "houses": (12, ["--resolution", 2048, "--closed", "off"], "az=10,el=40"),
    "hall": (20, ["--resolution", 1024], "az=70,el=30"),
}
QUERIES = [{"taps": 1}, {"taps": 9}, {"taps": 17}, {"taps": 9, "filter": "tent"}, {"taps": 17, "filter": "tent"},
           {"taps": 9, "format": "u8"}, {"taps": 9, "format": "bit"}, {"taps": 5, "filter": "gaussian"},
           {"taps": 3, "filter": "footprint", "footprint_m": 2.5}, {"level": 3}, {"taps": 9, "bias": "none"}]
OPTIONS = {"taps": "--taps", "filter": "--filter", "footprint_m": "--footprint", "level": "--level", "bias": "--bias"}


def need_package():
    """Skips the test where the package is not built."""
    if not os.path.exists(os.path.join(PACKAGE, "umbrage.wasm")):
        ut.skip("the package umbrage is not built: make web (clang, lld, wasi-libc, libclang-rt-dev-wasm32)")


def count_checks(test, checks):
    assert checks, "the suite ran no check"
    for one in checks:
        with test.check(f"{one['name']} {one['detail'] if one['ok'] else ''}"):
            assert one["ok"], one["detail"]


def sizes():
    """Bytes of the package and of its module, and of the module compressed."""
    files = [os.path.join(PACKAGE, name) for name in os.listdir(PACKAGE)]
    with open(os.path.join(PACKAGE, "umbrage.wasm"), "rb") as file:
        module = file.read()
    return {"module": len(module), "module_gzip": len(gzip.compress(module, 9)),
            "package": sum(os.path.getsize(path) for path in files)}


class Cases:
    """Files in the test's folder, and the configurations that name them."""

    def __init__(self, test, scenes=tuple(SCENES)):
        self.test, self.ids, self.scenes = test, {}, scenes
        for name in scenes:
            size, options, camera = SCENES[name]
            scene = test.scene(name, size)
            self.ids[f"{name}.umb"] = test.bake(scene, test.path(f"{name}.umb"), "--verify", 0, *options)["asset"]
            ut.run("umbrage", "points", scene, "-o", test.path(f"{name}.f32"), "--kind", "gbuffer", "--count", POINTS,
                   "--camera", camera, "--normals", "--quiet")

    def _answers(self, name, number, settings, points, *options):
        """The native answers in a file; returns its name."""
        out = f"{name}-{number}.answers"
        words = [word for key, value in settings.items() if key in OPTIONS for word in (OPTIONS[key], value)]
        ut.run("umbrage", "query", self.test.path(f"{name}.umb"), "--points", self.test.path(points), "--quiet",
               "--encoding", settings.get("format", "f32"), "-o", self.test.path(out), *words, *options)
        return out

    def _bits(self, name):
        for number, settings in enumerate(QUERIES):
            yield {"asset": f"{name}.umb", "points": f"{name}.f32", "normals": True, "settings": settings,
                   "expected": self._answers(name, number, settings, f"{name}.f32", "--format", "f32", "--normals")}
        rng, wide = random.Random(7), f"{name}.f64"
        with open(self.test.path(wide), "wb") as file:
            file.write(ut.floats([rng.uniform(-300, 300) for _ in range(3 * POINTS // 8)], "d"))
        for number, settings in enumerate([{"taps": 1}, {"taps": 9}]):
            yield {"asset": f"{name}.umb", "points": wide, "wide": True, "settings": settings,
                   "expected": self._answers(name, f"wide{number}", settings, wide, "--format", "f64")}

    def some(self):
        """The street of the city: bounds, overlapping calls, a budget."""
        expected = self._answers("city", "street", {"taps": 9}, "city.f32", "--format", "f32", "--normals")
        street = {"asset": "city.umb", "points": "city.f32", "normals": True, "settings": {"taps": 9},
                  "expected": expected, "camera": STREET}
        return {"ids": self.ids, "bounds": [street], "budgets": [{**street, "memory": 1_000_000}]}

    def all(self, rounds):
        with open(self.test.path("city.umb"), "rb") as file:
            city = file.read()
        # Behind the first read, which opens the asset.
        pages = forged_pages.page_count(city)
        page, lie = next((page, lie) for page in range(pages // 2, pages) if (lie := forged_pages.forge(city, page)))
        with open(self.test.path("forged.umb"), "wb") as file:
            file.write(lie)
        ut.run("umbrage-bake", self.test.scene("city", 2), "-o", self.test.path("small.umb"), "--resolution", 512,
               "--verify", 0, "--quiet")
        with open(self.test.path("small.umb"), "rb") as file:
            small, rng, sealed = file.read(), random.Random(20261123), []
        for number in range(rounds // 2):
            sealed.append(f"spoilt-{number}.umb")
            with open(self.test.path(sealed[-1]), "wb") as file:
                file.write(forged_pages.spoil(small, rng))
        return {**self.some(), "bits": [one for name in self.scenes for one in self._bits(name)],
                "mistakes": [{"asset": "city.umb"}], "forged": [{"forged": "forged.umb", "page": page}],
                "hostile": [{"asset": "small.umb", "rounds": rounds - len(sealed), "seed": 20261123,
                             "sealed": sealed}]}


def example():
    """The first example of docs/guide/web.md."""
    with open(os.path.join(ut.ROOT, "docs/guide/web.md"), encoding="utf-8") as file:
        return re.search(r"<!-- example -->\n```js\n(.*?)```", file.read(), re.DOTALL).group(1)


def check_example(test, cases):
    with test.check("the guide's example runs, and the package works where npm puts it"):
        place = test.path("project", "node_modules", "umbrage")
        os.makedirs(os.path.dirname(place))
        shutil.copytree(PACKAGE, place)
        shutil.copy(test.path("city.umb"), test.path("project", "city.umb"))
        code = example().replace("https://example.org/", "").replace("98292c97...", cases.ids["city.umb"])
        assert len(code.splitlines()) <= 10, code
        with open(test.path("project", "example.mjs"), "w", encoding="utf-8") as file:
            file.write(code)
        done = subprocess.run(["node", "--no-warnings", "example.mjs"], cwd=test.path("project"), check=True,
                              timeout=60, stdout=subprocess.PIPE)
        assert re.fullmatch(r"\d+ of \d+ answers are exact, the first is [01].*\n", done.stdout.decode()), done.stdout
    if shutil.which("tsc") is None:
        ut.left_out("types of the package", "tsc is not installed (node-typescript)")
        return
    with test.check("TypeScript accepts the right uses of the package and refuses the wrong ones"):
        shutil.copy(os.path.join(ut.ROOT, "tests/web/types.ts"), test.path("project", "types.ts"))
        done = subprocess.run(["tsc", "--strict", "--noEmit", "--target", "es2022", "--module", "es2022", "--lib",
                               "es2022,dom", "--moduleResolution", "node", "types.ts"], cwd=test.path("project"),
                              check=False, timeout=120, stdout=subprocess.PIPE)
        assert done.returncode == 0, done.stdout.decode()


class Liar(http.server.BaseHTTPRequestHandler):
    """Answers /404, /long, /place and /cut otherwise than asked."""

    def do_GET(self):
        kind, asset = self.path.split("/")[1:3]
        first, last = (int(number) for number in self.headers["Range"].removeprefix("bytes=").split("-"))
        with open(os.path.join(self.server.folder, asset), "rb") as file:
            file.seek(first)
            body = file.read(last - first + 1)
        self.send_response(404 if kind == "404" else 206)
        self.send_header("Content-Range", f"bytes {first + (kind == 'place')}-{last}/{1 << 30}")
        self.end_headers()
        self.wfile.write(body[:len(body) // 2] if kind == "cut" else body * (3 if kind == "long" else 1))

    def log_message(self, *_):
        pass


def check_servers(test):
    """Servers that answer otherwise than asked are named, and an endless answer is not read to its end."""
    liar = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Liar)
    liar.daemon_threads, liar.folder, liar.handle_error = True, test.folder, lambda *_: None
    threading.Thread(target=liar.serve_forever, daemon=True).start()
    without = link.RangeServer(test.folder, serves_ranges=False)
    place = f"http://127.0.0.1:{liar.server_address[1]}"
    wanted = {f"{place}/404/city.umb": ["E_NOT_FOUND", "status 404"],
              f"{place}/long/city.umb": ["E_PROTOCOL", "sends more than the 16384 bytes"],
              f"{place}/place/city.umb": ["E_PROTOCOL", "sends byte 1, asked for 0"],
              f"{place}/cut/small.umb": ["E_TRUNCATED", ""],
              f"http://127.0.0.1:{without.port}/city.umb": ["E_UNSUPPORTED", "knows no byte ranges (status 200"],
              "http://127.0.0.1:1/city.umb": ["E_UNAVAILABLE", "http://127.0.0.1:1/city.umb: "],
              test.path("no.umb"): ["E_NO_INPUT", "no.umb"]}
    code = """
        const { open } = await import(process.argv[1]);
        for (const [address, [code, words]] of Object.entries(JSON.parse(process.argv[2]))) {
          const error = await open(address).then((asset) => asset.want({})).then(() => ({}), (error) => error);
          if (error.code !== code || !error.message.includes(words)) {
            throw new Error(`${address}: ${error.code} ${error.message}`);
          }
        }"""
    with test.check("servers that answer otherwise than asked are named"):
        subprocess.run(["node", "--no-warnings", "--input-type=module", "-e", code, os.path.join(PACKAGE, "index.js"),
                        json.dumps(wanted)], check=True, timeout=60)
    with test.check("a server without byte ranges gives the whole file, up to whole_bytes, with the same answers"):
        size = os.path.getsize(test.path("city.umb"))
        done = subprocess.run(["node", "--no-warnings", "--input-type=module", "-e", """
            const [, index, address, path, size] = process.argv, { open } = await import(index);
            const points = Float32Array.from({ length: 3000 }, (_, i) => ((i * 7919) % 1000) / 10 - 50), told = [];
            for (const where of [address, path]) {
              const asset = await open(where, { whole_bytes: Number(size) });
              await asset.want({});
              told.push(JSON.stringify(Array.from((await asset.query(points, { taps: 5 })).values)));
              told.push(asset.held().received_bytes);
            }
            const small = await open(address, { whole_bytes: Number(size) - 1 }).catch((error) => error);
            console.log(JSON.stringify([told[0] === told[2], told[1], small.code, small.message]));
            """, os.path.join(PACKAGE, "index.js"), f"http://127.0.0.1:{without.port}/city.umb", test.path("city.umb"),
                               str(size)], check=True, timeout=60, stdout=subprocess.PIPE)
        same, received, code, message = json.loads(done.stdout)
        assert same and received == size and code == "E_UNSUPPORTED" and f"has {size} bytes" in message, done.stdout
    without.close()
    liar.shutdown()
