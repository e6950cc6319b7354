#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The Python module's types: `mypy --strict` accepts a user's script and the module, and finds the script's mistakes when
they are made; help() has a text for every public name.
"""
import inspect
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

umbrage, np = ut.need_module()
test = ut.Test()
SCRIPT = '''
import sys
import numpy as np
import numpy.typing as npt
import umbrage


def shares(asset: umbrage.Asset, points: npt.NDArray[np.float32]) -> dict[str, float]:
    """Mean light at the points, for each light."""
    found = {}
    for number, light in enumerate(asset.lights):
        values = asset.query(points, light=number, taps=9)
        found[light.name] = float(values.mean())
    return found


def sharpest(asset: umbrage.Asset) -> float:
    """Least bound of the first light's curve, metres."""
    return min(row.bound_m for row in asset.lights[0].curve)


def show(progress: umbrage.Progress) -> None:
    print(progress.phase, progress.done, progress.total)


def main(scene: str, out: str) -> int:
    umbrage.bake(scene, out, resolution=1024, sun="135,45", closed="off", verify=1000, progress=show)
    with umbrage.open(out) as asset:
        low, high = asset.info.bounds
        points = np.random.default_rng(1).uniform(low, high, (100, 3)).astype(np.float32)
        print(shares(asset, points), sharpest(asset))
        result = asset.query(points, max_error=5.0, stats=True)
        print(result.bound_m, int(result.exact.sum()), result.stats.points)
        print([one.taps for one in asset.query(points, light="all", stats=True)])
        segments = asset.segments(np.stack([points[:10], points[10:20]], 1), intervals=4)
        print(segments.lit.mean(), asset.columns(points).distance_m.max())
    with umbrage.open(out, partial=True) as part:
        held = part.fetch(umbrage.View(box=(low, high)), progress=lambda now: now.held_bytes > 1 << 20)
        print(held.pages_held, held.pages)
    try:
        with umbrage.connect("tcp:127.0.0.1:1", timeout=5.0) as daemon:
            print([listed.name for listed in daemon.assets()])
    except umbrage.Error as error:
        print(error.status)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1], sys.argv[2]))
'''
MISTAKES = [("row.bound_m", "row.bound_km"), ("progress=show", "progress=5"),
            ("taps=9", "tabs=9"), ("error.status", "error.state + 1"), ("light.name", "light.names"),
            ("held.pages_held", "held.page_held"), ("View(box=", "View(bax="), ("result.bound_m", "result.bound"),
            ("one.taps", "one.tapes"), ("timeout=5.0", "time_out=5.0")]


def mypy(text):
    with open(test.path("script.py"), "w", encoding="utf-8") as file:
        file.write(text)
    return subprocess.run(["mypy", "--strict", "--no-error-summary", "--cache-dir", test.path("cache"),
                           test.path("script.py")], env={**os.environ, "MYPYPATH": os.path.join(ut.BUILD, "python")},
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


try:
    subprocess.run(["mypy", "--version"], check=True, stdout=subprocess.DEVNULL)
    HAS_MYPY = True
except (OSError, subprocess.CalledProcessError):
    HAS_MYPY = False

if HAS_MYPY:
    with test.check("mypy --strict accepts a script and the module"):
        done = mypy(SCRIPT)
        assert done.returncode == 0, done.stdout
    with test.check("mypy finds each mistake"):
        wrong_script = SCRIPT
        for right, wrong in MISTAKES:
            assert SCRIPT.count(right) >= 1, right
            wrong_script = wrong_script.replace(right, wrong, 1)
        done = mypy(wrong_script)
        for number, line in enumerate(wrong_script.split("\n"), 1):
            if any(wrong in line for _, wrong in MISTAKES):
                assert f"script.py:{number}: error" in done.stdout, (line, done.stdout)
else:
    ut.left_out("types of the Python module", "mypy is not installed")

with test.check("the script runs as it stands"):
    with open(test.path("run.py"), "w", encoding="utf-8") as file:
        file.write(SCRIPT)
    path = os.pathsep.join([ut.BUILD, os.environ["PATH"]])
    done = subprocess.run([sys.executable, test.path("run.py"), test.scene("city", 8), test.path("out.umb")],
                          env={**os.environ, "PATH": path, "PYTHONPATH": os.path.join(ut.BUILD, "python")},
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0 and "E_UNAVAILABLE" in done.stdout, done.stdout


def unsaid(name, thing, names):
    """Those of the names that the help text of a thing lacks; [name] where it has no text."""
    text = inspect.getdoc(thing) or ""
    return [f"{name}: {one}" for one in names if not re.search(rf"\b{one}\b", text)] if len(text) > 15 else [name]


with test.check("help() of every public name, method and property names its parameters or fields, and what it raises"):
    tried, lacks = 0, []
    for name in umbrage.__all__:
        thing = getattr(umbrage, name)
        is_error = isinstance(thing, type) and issubclass(thing, umbrage.Error)
        if not isinstance(thing, type):
            lacks += unsaid(name, thing, inspect.signature(thing).parameters)
        elif not is_error:
            lacks += unsaid(name, thing, getattr(thing, "__dataclass_fields__", ()))
        for method in dir(thing) if isinstance(thing, type) and not is_error else ():
            body = inspect.getattr_static(thing, method)
            if not method.startswith("_") and isinstance(body, property):
                lacks += unsaid(f"{name}.{method}", body, ())
            elif not method.startswith("_") and callable(body):
                lacks += unsaid(f"{name}.{method}", getattr(thing, method), [
                    one.name for one in inspect.signature(body).parameters.values()
                    if one.name not in ("self", "cls") and one.kind != one.POSITIONAL_ONLY])
                tried += 1
    assert tried > 40 and not lacks, (tried, lacks)
    for one in (umbrage.open, umbrage.connect, umbrage.bake, umbrage.Daemon, umbrage.Asset.query, umbrage.Asset.segments,
                umbrage.Asset.columns, umbrage.Asset.boxes, umbrage.Asset.derive, umbrage.Asset.explain, umbrage.Asset.fetch,
                umbrage.Daemon.submit, umbrage.Daemon.fetch, umbrage.Daemon.watch):
        assert re.search(r"\b[Rr]aises\b", inspect.getdoc(one)), one

test.finish()
