#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
What the plan decides and states: closed or open by bytes (a short form of `make plan-scenes`), the up
axis of OBJ, PLY and STL, and BLEND materials that could be cut-outs. Forecasts are compared with the
files that bakes write.
"""
import json
import os
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "harness"))
sys.path.insert(0, os.path.join(HERE, "..", "bench"))
sys.path.insert(0, os.path.join(HERE, "..", "scenes"))
import umbrage_test as ut  # noqa: E402
import plan_mixes  # noqa: E402
import plan_scenes  # noqa: E402

test = ut.Test()
SCENES = os.environ.get("UMBRAGE_SCENES", os.path.join(ut.ROOT, "..", "shared", "scenes"))


def bake(*words, code=0):
    return ut.run("umbrage-bake", *words, code=code)


def plan_of(path, *words):
    """(JSON of --plan, what stands on stderr)"""
    done = bake(path, "--plan", "--json", *(() if "--resolution" in words else ("--resolution", 256)), *words)
    return json.loads(done.stdout), done.stderr.decode()


def line_of(plan, effect):
    lines = [line for line in plan["plan"] if line.startswith(f"effect={effect} ")]
    return lines[0] if lines else ""


# With the former rule (closed if at least 2.5 % of the area is): off, off, on, on, off.
for name, resolution, closed in (("objects_on_land", 4096, True), ("small_town_on_wide_plane", 4096, True),
                                 ("five_closed_of_216", 1024, False), ("trees_on_solid_land", 2048, True),
                                 ("few_objects_on_land", 16384, True)):
    with test.check(f"{name} at {resolution}: the smaller file is chosen, and its bytes were said"):
        path = plan_mixes.write(name, test.folder)
        row, wrong = plan_scenes.judge(path, resolution, test.folder, 1.3)
        assert not wrong and row["off"] == 0, (wrong, row)
        assert (row["chosen"] == "closed") == closed, row

with test.check("the plan states both sizes, what is lost, and the word that changes it"):
    path = os.path.join(test.folder, "objects_on_land.obj")
    on, _ = plan_of(path, "--resolution", 2048)
    assert " closed, " in line_of(on, "closed") and " open" in line_of(on, "closed"), on["plan"]
    assert "no penumbras, columns and derived maps" in line_of(on, "closed"), on["plan"]
    off, _ = plan_of(plan_mixes.write("five_closed_of_216", test.folder))
    assert "state=off" in line_of(off, "closed") and "--closed parts" in line_of(off, "closed"), off["plan"]
    assert "it saves nothing" not in line_of(off, "closed"), off["plan"]
    parts, _ = plan_of(os.path.join(test.folder, "five_closed_of_216.obj"), "--closed", "parts")
    assert "state=on" in line_of(parts, "closed"), parts["plan"]

with test.check("tile and merge, threads and memory choose as a bake does: equal ids"):
    ids, words = set(), [path, "--resolution", 8192, "--verify", 0, "--quiet", "--json", "--tile", 2048]
    for number, more in enumerate((["--threads", 1], ["--threads", 3, "--memory", "200MiB", "--depth", "plain"])):
        done = bake(*words, *more, "-o", os.path.join(test.folder, f"{number}.umb"))
        ids.add(json.loads(done.stdout)["asset"])
    bake("tile", path, "-o", os.path.join(test.folder, "tiles"), "--resolution", 8192, "--tile", 2048, "--quiet")
    done = bake("merge", *words, "--from", os.path.join(test.folder, "tiles"), "-o", os.path.join(test.folder, "m.umb"))
    ids.add(json.loads(done.stdout)["asset"])
    assert len(ids) == 1, ids

with test.check("an asset holds no bytes that depend on the compression"):
    done = ut.run("umbrage", "info", os.path.join(test.folder, "0.umb"))
    text = done.stdout.decode()
    assert "closed saves about" in text and " open, going by" not in text and "kB closed" not in text, text

# Files as other programs write them; a file without evidence gets z, with a warning.
HELD = {"hair_long01/long01.obj": ("y", True), "scan_lionstatue/lionstatue.obj": ("y", True),
        "scan_ycb_banana/textured_simple_reoriented.obj": ("z", False),
        "garden_sterngarten/Sterngarten_Wien_innerArea-optimized.obj": ("z", True),
        "city_delft/delft_all.obj": ("z", True), "city_denhaag/denhaag_9solids.obj": ("z", True),
        "geo_delft_rd/delft_epsg7415.obj": ("z", True), "broken_trimesh/singlevn.obj": ("y", True),
        "broken_trimesh/nancolor.obj": ("z", False), "broken_trimesh/busted.STL": ("z", False),
        "broken_trimesh/plate_holes.STL": ("z", True), "terrain_jacksboro/jacksboro.ply": ("z", True)}
for name, (up, known) in HELD.items():
    path = os.path.join(SCENES, name)
    if not os.path.exists(path):
        ut.left_out(name, "the scene is not here")
        continue
    with test.check(f"{name}: {up} is up, {'as the file tells' if known else 'and a warning says how to change it'}"):
        plan, stderr = plan_of(path)
        assert plan["up"] == up, plan
        assert ("--up" in stderr) == (not known), stderr
        assert ("--up" in plan["up_reason"]) == (not known), plan["up_reason"]
        for word in ("y", "z"):
            forced, stderr = plan_of(path, "--up", word)
            assert forced["up"] == word and "warning" not in stderr, (forced["up"], stderr)
            assert forced["up_reason"] == "--up says so", forced

with test.check("commands that look at a scene without an up axis warn as well"):
    cube = os.path.join(test.folder, "cube.obj")
    with open(cube, "w", encoding="ascii") as file:
        file.writelines(f"v {i & 1} {i >> 1 & 1} {i >> 2}\n" for i in range(8))
        file.write("f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n")
    words = ["points", cube, "--kind", "gbuffer", "--count", 10, "-o", os.path.join(test.folder, "points")]
    assert b"--up" in ut.run("umbrage-study", *words).stderr
    assert b"warning" not in ut.run("umbrage-study", *words, "--up", "y").stderr
    assert b"warning" not in ut.run("umbrage-study", *words, "--quiet").stderr

leaves, soft, mask = (os.path.join(test.folder, name) for name in ("leaves.glb", "soft.glb", "mask.glb"))
plan_mixes.write_leaves(leaves)
plan_mixes.write_leaves(soft, edge=6)
plan_mixes.write_leaves(mask, "MASK")


def baked(path, *words):
    asset = path + "".join(words) + ".umb"
    bake(path, "--resolution", 1024, "--quiet", "--verify", 20000, "-o", asset, *words)
    return asset


with test.check("BLEND leaves are offered as cut-outs, with the bytes of both"):
    plan, _ = plan_of(leaves, "--resolution", 1024)
    line = line_of(plan, "blend-cut-out")
    assert "state=off" in line and "material 'leaf'" in line and "--effect blend-cut-out=on" in line, plan["plan"]
    as_blend, as_cut = baked(leaves), baked(leaves, "--effect", "blend-cut-out=on")
    for asset, said in ((as_blend, plan["blend_price"]["blend_bytes"]), (as_cut, plan["blend_price"]["cut_out_bytes"])):
        assert 1 / 1.3 < (said + plan_scenes.HEAD_BYTES) / os.path.getsize(asset) < 1.3, (asset, said)

with test.check("taken as cut-outs, they are baked as a MASK material with the same texture"):
    plan, _ = plan_of(leaves, "--effect", "blend-cut-out=on")
    assert "state=on" in line_of(plan, "blend-cut-out") and not line_of(plan, "transmittance"), plan["plan"]
    assert "state=on" in line_of(plan, "cut-out"), plan["plan"]
    same = baked(mask)
    done = ut.run("umbrage", "info", as_cut, "--json"), ut.run("umbrage", "info", same, "--json")
    nodes = [json.loads(one.stdout)["level_nodes"] for one in done]
    assert nodes[0] == nodes[1], nodes
    found = ut.run("umbrage", "verify", as_cut, "--scene", leaves).stdout.decode()
    assert "outside the band: 0 " in found, found

with test.check("pictures cast them as cut-outs, and show them as the file has them"):
    def drawn(scene, asset):
        picture = os.path.join(test.folder, "leaves.png")
        return json.loads(ut.run("umbrage", "render", scene, "--asset", asset, "-o", picture, "--size", "320x240",
                                 "--compare", "--taps", "1", "--json").stdout)
    cut, masked = drawn(leaves, as_cut), drawn(mask, same)
    assert cut["translucent"] > 0 and masked["translucent"] == 0, (cut, masked)
    # Equal casters: the receivers differ by the soft edges of leaves alone, less than 1 % of them.
    assert abs(cut["mean_difference"] / masked["mean_difference"] - 1) < 0.05, (cut, masked)

with test.check("leaves with soft edges are not offered"):
    plan, _ = plan_of(soft)
    assert not line_of(plan, "blend-cut-out"), plan["plan"]
    ut.run("umbrage-bake", soft, "--plan", "--effect", "blend-cut-out=maybe", code=2)

test.finish()
