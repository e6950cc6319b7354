#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Tiles as the unit of work: an asset's id must not depend on how the bake was divided, killed, resumed
or shared. An edit must bake only the tiles that it reaches. Damage and a full disk must be survived.
"""
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

BUILD = os.environ.get("BUILD", "build/release")
BAKE = os.path.join(BUILD, "umbrage-bake")
SETTINGS = ["--resolution", "4096", "--tile", "512", "--sun", "140,38", "--quiet", "--json"]
failures = 0


def check(name, good, seen=""):
    global failures
    print("ok  " if good else "FAIL", name, "" if good else seen)
    failures += not good


def bake(*words, expect=0):
    """Runs umbrage-bake; returns what it printed as JSON, or its complaint."""
    done = subprocess.run([BAKE, *words], capture_output=True, text=True, check=False)
    if done.returncode != expect:
        check(" ".join(words), False, f"exit code {done.returncode}: {done.stderr}")
    return json.loads(done.stdout) if done.returncode == 0 and done.stdout else done.stderr


def box(low, high):
    """A closed box as OBJ corners and faces, numbered from 1."""
    corners = [[(low, high)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    return corners, faces


def write_boxes(path, boxes):
    with open(path, "w", encoding="ascii") as out:
        for number, (low, high) in enumerate(boxes):
            corners, faces = box(low, high)
            for corner in corners:
                print("v", *corner, file=out)
            for face in faces:
                print("f", *(8 * number + corner for corner in face), file=out)


def make_city(moved=0.0):
    """A plate with 900 boxes on it; the last one stands elsewhere when moved."""
    draw = random.Random(7)
    boxes = [((-100, -100, -1), (100, 100, 0))]
    for i in range(900):
        x, y = 6.5 * (i % 30) - 97, 6.5 * (i // 30) - 97
        boxes.append(((x, y, 0.01), (x + 2 + 3 * draw.random(), y + 4, 1 + 6 * draw.random())))
    boxes.append(((-60 + moved, -1.5, 9), (-59 + moved, -0.5, 10)))
    return boxes


def edits(folder, scene):
    """The case of 64 tiles in which one small object moves."""
    cache, moved = os.path.join(folder, "cache"), os.path.join(folder, "moved.obj")
    out = os.path.join(folder, "a.umb")
    full = bake(scene, "-o", out, "--verify", "0", *SETTINGS)
    first = bake(scene, "-o", out, "--cache", cache, "--verify", "0", *SETTINGS)
    again = bake(scene, "-o", out, "--cache", cache, "--verify", "0", *SETTINGS)
    check("with a cache: the same id", full["asset"] == first["asset"] == again["asset"])
    check("a cold cache finds nothing, a warm one everything",
          (first["tiles_found"], again["tiles_found"], again["texels"]) == (0, 64, 0), again)
    write_boxes(moved, make_city(50.0))
    whole = bake(moved, "-o", out, "--verify", "0", *SETTINGS)
    edited = bake(moved, "-o", out, "--cache", cache, "--verify", "0", *SETTINGS)
    check("an edited scene has another id", whole["asset"] != full["asset"])
    check("baking what an edit reaches gives the id of a full bake",
          edited["asset"] == whole["asset"])
    baked = 64 - edited["tiles_found"]
    print(f"    {baked} of 64 tiles baked again; bake {whole['seconds']['bake']:.3f} s in full, "
          f"{edited['seconds']['bake']:.3f} s of the edit")
    check("an edit bakes 2 to 8 of 64 tiles", 2 <= baked <= 8, baked)
    bake(moved, "-o", out, "--cache", cache, "--cache-size", "1MiB", "--verify", "0", *SETTINGS)
    size = sum(os.path.getsize(os.path.join(cache, name)) for name in os.listdir(cache))
    check("the cache keeps its size", size <= 1 << 20, size)
    return full["asset"]


def damage(folder, scene, asset):
    cache, out = os.path.join(folder, "cache2"), os.path.join(folder, "a.umb")
    bake(scene, "-o", out, "--cache", cache, "--verify", "0", *SETTINGS)
    for number, name in enumerate(sorted(os.listdir(cache))):
        with open(os.path.join(cache, name), "r+b") as file:
            if number % 3 == 0:
                file.truncate(os.path.getsize(file.name) // 2)
            elif number % 3 == 1:
                file.seek(os.path.getsize(file.name) // 2)
                file.write(b"\x55\xaa\x55")
    report = bake(scene, "-o", out, "--cache", cache, "--verify", "0", *SETTINGS)
    check("damaged tiles are baked again", report["tiles_found"] == 21 and
          report["tiles_damaged"] == 43 and report["asset"] == asset, report)


def farm(folder, scene, asset):
    """Tiles by several processes at once, one of them twice, one killed; then a merge."""
    tiles, out = os.path.join(folder, "tiles"), os.path.join(folder, "farm.umb")
    killed = subprocess.Popen([BAKE, "tile", scene, "-o", tiles, "--only", "0-20", *SETTINGS],
                              stdout=subprocess.DEVNULL)
    while killed.poll() is None and (not os.path.isdir(tiles) or len(os.listdir(tiles)) < 4):
        time.sleep(0.001)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    problem = bake("merge", scene, "--from", tiles, "-o", out, *SETTINGS, expect=75)
    check("a merge names the missing tile", "tile" in problem and "--only" in problem, problem)
    check("a merge that failed leaves nothing", not os.path.exists(out))
    problem = bake("merge", scene, "--from", tiles + "x", "-o", out, *SETTINGS, expect=66)
    check("a merge makes no folder of tiles", "--from" in problem and
          not os.path.exists(tiles + "x"), problem)
    workers = [subprocess.Popen([BAKE, "tile", scene, "-o", tiles, "--only", only, *SETTINGS],
                                stdout=subprocess.DEVNULL)
               for only in ("0-20", "0-31", "21-62", "63")]
    check("tiles at once", [worker.wait() for worker in workers] == [0] * 4)
    merged = bake("merge", scene, "--from", tiles, "-o", out, "--verify", "20000", *SETTINGS)
    check("merged tiles have the id of one bake", merged["asset"] == asset, merged)
    check("nothing is baked by a merge", merged["texels"] == 0)
    report = bake("tile", scene, "-o", tiles, *SETTINGS)
    check("tiles that are there are left alone", report["tiles_found"] == 64, report)
    bake("merge", scene, "--from", tiles, "-o", out, *SETTINGS[:1], "2048", *SETTINGS[2:],
         expect=75)
    bake("tile", scene, "-o", tiles, "--only", "64", *SETTINGS, expect=2)
    plan = bake(scene, "--plan", *SETTINGS)
    check("the plan counts tiles", plan["tiles"] == 64, plan)


def imported(folder, scene, asset):
    """A scene read once stands for the scene in every command; damage is found."""
    once, out = os.path.join(folder, "once.scene"), os.path.join(folder, "once.umb")
    tiles = os.path.join(folder, "tiles")
    report = bake("import", scene, "-o", once, "--quiet", "--json")
    check("import tells what it read", report["triangles"] == 902 * 12, report)
    check("a scene file bakes to the same id",
          bake("--scene-buffer", once, "-o", out, "--verify", "0", *SETTINGS)["asset"] == asset)
    check("its tiles are those of the scene",
          bake("tile", "--scene-buffer", once, "-o", tiles, *SETTINGS)["tiles_found"] == 64)
    check("and merge", bake("merge", "--scene-buffer", once, "--from", tiles, "-o", out,
                            "--verify", "20000", *SETTINGS)["asset"] == asset)
    for name in ("once.scene", "evil.glb", "evil.gltf", "evil.obj", "evil.ply", "evil.stl"):
        evil = os.path.join(folder, name)
        if evil != once:
            shutil.copy(once, evil)
        problem = bake(evil, "--plan", "--quiet", expect=65)
        check(f"{name} is no scene without the word", "--scene-buffer" in problem, problem)
    os.chmod(once, 0o620)
    problem = bake("--scene-buffer", once, "--plan", "--quiet", expect=77)
    check("a scene file that others can write is refused", once in problem and "0620" in problem and
          "chmod go-w" in problem, problem)
    os.chmod(once, 0o600)
    with open(once, "rb") as file:
        whole = file.read()
    for number in range(24):
        cut, flip = number * len(whole) // 24, bytearray(whole)
        flip[8 + number * (len(whole) - 8) // 24] ^= 1 << number % 8
        for damaged in (whole[:cut], bytes(flip)):
            with open(once, "wb") as file:
                file.write(damaged)
            bake("--scene-buffer", once, "--plan", "--quiet", expect=65)


def lights(folder, scene):
    """Tiles are counted over all faces of all lights, and each face must find its own."""
    tiles, out = os.path.join(folder, "lit"), os.path.join(folder, "lit.umb")
    settings = ["--resolution", "512", "--tile", "128", "--sun", "135,45", "--point", "3,4,30",
                "--spot", "0,0,40,0.1,0,-1,30", "--quiet", "--json"]
    plan = bake(scene, "--plan", *settings)
    check("seven faces of 16 tiles", (plan["frusta"], plan["tiles"]) == (7, 112), plan)
    whole = bake(scene, "-o", out, "--verify", "0", "--tile", "512", *settings[:2], *settings[4:])
    for only in ("0-20", "21-70", "70-111"):
        bake("tile", scene, "-o", tiles, "--only", only, *settings)
    merged = bake("merge", scene, "--from", tiles, "-o", out, "--verify", "20000", *settings)
    check("tiles of several lights merge to the id of one bake", merged["asset"] == whole["asset"])


def killed_and_resumed(folder, scene, asset):
    """kill -9 at random moments, each with more tiles in the cache; then the same command goes on."""
    cache, out = os.path.join(folder, "cache3"), os.path.join(folder, "resumed.umb")
    draw = random.Random(11)
    for kept in range(0, 18, 3):
        process = subprocess.Popen([BAKE, scene, "-o", out, "--cache", cache, *SETTINGS],
                                   stdout=subprocess.DEVNULL)
        while process.poll() is None and kept > 0 and (
                not os.path.isdir(cache) or len(os.listdir(cache)) < kept):
            time.sleep(0.001)
        time.sleep(0.1 * draw.random())
        process.kill()
        process.wait()
    check("a killed bake leaves no asset, or a whole one", not os.path.exists(out) or subprocess.run(
        [os.path.join(BUILD, "umbrage"), "verify", out, "--quiet"], check=False).returncode == 0)
    report = bake(scene, "-o", out, "--cache", cache, "--verify", "20000", *SETTINGS)
    check("resumed: the same id", report["asset"] == asset, report)
    check("resumed: tiles of killed bakes are used", report["tiles_found"] > 0, report)


def interrupted(folder, scene):
    """Each of the signals that end a bake leaves the cache and nothing else."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        place = os.path.join(folder, f"signal{number}")
        os.mkdir(place)
        cache = os.path.join(folder, f"signalled{number}")
        process = subprocess.Popen([BAKE, scene, "-o", os.path.join(place, "a.umb"), "--cache", cache,
                                    *SETTINGS, "--verify", "1000000000"], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        while process.poll() is None and not (os.path.isdir(cache) and os.listdir(cache)):
            time.sleep(0.0005)
        process.send_signal(number)
        try:
            code = process.wait(20)
        finally:
            process.kill()
        check(f"signal {number} ends a bake with 75 and leaves nothing",
              (code, os.listdir(place)) == (75, []), (code, os.listdir(place)))
        strays = [name for name in os.listdir(cache) if not name.endswith(".umbt")]
        check(f"signal {number} leaves whole tiles only", strays == [], strays)


def main():
    with tempfile.TemporaryDirectory() as folder:
        scene = os.path.join(folder, "city.obj")
        write_boxes(scene, make_city())
        asset = edits(folder, scene)
        damage(folder, scene, asset)
        farm(folder, scene, asset)
        imported(folder, scene, asset)
        lights(folder, scene)
        killed_and_resumed(folder, scene, asset)
        interrupted(folder, scene)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
