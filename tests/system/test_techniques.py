#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
`umbrage-study techniques`, `umbrage-study deep` and `umbrage aliasing`: every technique is compared with rays on the
same points of a generated scene.

Bounds: PCF may be wrong only at texels that an edge crosses. The techniques must rank as in docs/results/techniques.md,
where every scene shows the same ranking.
"""
import os
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402
import json  # noqa: E402
import re  # noqa: E402

test = ut.Test()
scene = os.path.join(test.folder, "arch.glb")
picture = os.path.join(test.folder, "sheet.png")
subprocess.run([ut.program("scenegen"), "arch", "--size", "4", "-o", scene], check=True)


def study(*more):
    return subprocess.run([ut.program("umbrage-study"), "techniques", scene, *more],
                          capture_output=True, timeout=120)


run = study("--resolution", "256", "--size", "96x64", "--taps", "5", "-o", picture, "--json")
rows = {row["name"]: row for row in json.loads(run.stdout)["techniques"]} if run.returncode == 0 else {}

with test.check("it runs, and draws the truths and every technique"):
    assert run.returncode == 0, run.stderr
    with open(picture, "rb") as png:
        assert png.read(8) == b"\x89PNG\r\n\x1a\n"
    assert len(rows) >= 25, sorted(rows)

with test.check("percentage closer filtering is nearest to the truth"):
    assert rows["pcf-f32"]["mean"] < 0.02, rows["pcf-f32"]
    for name, row in rows.items():
        if row["truth"] == "box" and not name.startswith("pcf"):
            assert row["mean"] > rows["pcf-f32"]["mean"], row

with test.check("techniques that bound from above are hardly ever darker"):
    for name in ("vsm", "vsm-sat", "lvsm-4", "esm-80", "evsm-log", "msm-f32"):
        assert rows[name]["darker"] < rows["pcf-f32"]["darker"] + 0.002, rows[name]

with test.check("errors fall as the parameter rises"):
    for family in (("convolution-4", "convolution-16"),
                   ("vsm", "evsm-f32"), ("msm-u16", "msm-f32", "msm-sat")):
        means = [rows[name]["mean"] for name in family]
        assert means == sorted(means, reverse=True), (family, means)

with test.check("from within the scene, more slices of the view are nearer to the truth than one map"):
    run = study("--resolution", "256", "--size", "96x64", "--taps", "5", "--camera",
                "eye=2,2,2,target=20,0,20,fov=60", "--json")
    near = {row["name"]: row["mean"] for row in json.loads(run.stdout)["techniques"]}
    for family in (("map-f32", "pssm-map-2", "pssm-map-4"), ("pssm-map-2", "pssm-lispsm-4"),
                   ("pssm-vsm-2", "pssm-vsm-4", "pssm-evsm-4")):
        means = [near[name] for name in family]
        assert means == sorted(means, reverse=True), (family, means)

with test.check("cascades of variance maps have a contrast for each layer, which brings layers together"):
    run = study("--resolution", "256", "--size", "256x160", "--taps", "9", "--only", "pssm-vsm", "--camera",
                "eye=2,2,2,target=20,0,20,fov=60", "--json")
    pssm = {row["name"]: row for row in json.loads(run.stdout)["techniques"]}
    assert sorted(pssm) == ["pssm-vsm-2", "pssm-vsm-4", "pssm-vsm-4-blend", "pssm-vsm-4-c1"], pssm
    matched, plain = pssm["pssm-vsm-4"]["seams"], pssm["pssm-vsm-4-c1"]["seams"]
    assert [seam["jump_c1"] for seam in matched] == [seam["jump"] for seam in plain], (matched, plain)
    assert all(seam["contrast"] == 1 for seam in plain) and any(seam["contrast"] != 1 for seam in matched), matched
    assert sum(s["jump"] ** 2 for s in matched) < sum(s["jump"] ** 2 for s in plain), (matched, plain)

with test.check("PCSS over filtered maps, several depths a texel and 2 x 2 comparisons are rows"):
    assert rows["pcss-msm"]["mean"] < rows["pcss-esm-80"]["mean"], rows
    assert rows["pcss"]["mean"] <= rows["pcss-msm"]["mean"], rows
    assert rows["vsm-ms4"]["bytes"] == rows["vsm"]["bytes"] and rows["vsm-ms4"]["mean"] != rows["vsm"]["mean"], rows
    assert rows["pcf-2x2"]["truth"] == "point" and rows["pcf-2x2"]["bytes"] == rows["map-f32"]["bytes"], rows

with test.check("a lamp has a cube's faces or two paraboloids"):
    run = study("--resolution", "256", "--size", "96x64", "--taps", "5", "--lamp", "8,6,8", "-o", picture, "--json")
    assert run.returncode == 0, run.stderr
    lamp = {row["name"]: row for row in json.loads(run.stdout)["techniques"]}
    assert len(lamp) == 14, sorted(lamp)
    for kind in ("cube", "paraboloid"):
        assert lamp[kind + "-map"]["mean"] < 0.05, lamp
        for name in ("vsm", "esm-80", "evsm", "msm"):
            assert lamp[f"{kind}-{name}"]["mean"] > lamp[kind + "-pcf"]["mean"], (kind, name, lamp)
    bad = study("--lamp", "1,2")
    assert bad.returncode == 2 and b"--lamp: '1,2' is not a position" in bad.stderr, bad
    bad = study("--only", "no-such", "--resolution", "64", "--size", "16x10")
    assert bad.returncode == 2 and b"--only: 'no-such'" in bad.stderr, bad

with test.check("an asset is two rows more, the nearer to the truth the finer it is"):
    means = []
    for resolution in ("256", "2048"):
        asset = os.path.join(test.folder, "arch.umb")
        subprocess.run([ut.program("umbrage-bake"), scene, "-o", asset, "--resolution", resolution,
                        "--verify", "0", "--quiet"], check=True)
        run = study("--resolution", "256", "--size", "96x64", "--taps", "5", "--asset", asset,
                    "--only", "dag", "--json")
        dag = {row["name"]: row for row in json.loads(run.stdout)["techniques"]}
        assert dag["dag-1"]["bytes"] == dag["dag-5"]["bytes"] > 0, dag
        means.append((dag["dag-1"]["mean"], dag["dag-5"]["mean"]))
    assert means[1][0] < means[0][0] and means[1][1] < means[0][1], means
    wrong = study("--asset", asset, "--sun", "10,20")
    assert wrong.returncode == 2 and b"--asset" in wrong.stderr, wrong

with test.check("the same points give the same errors again, on one thread"):
    again = study("--resolution", "256", "--size", "96x64", "--taps", "5", "--threads", "1", "--json")
    for row in json.loads(again.stdout)["techniques"]:
        assert row["mean"] == rows[row["name"]]["mean"], row

with test.check("what is out of range is named"):
    for arguments, name in ((["--taps", "4"], "--taps"), (["--resolution", "100"], "--resolution"),
                            (["--sun", "1,-5"], "--sun"), (["--light-size", "0"], "--light-size")):
        bad = study(*arguments)
        assert bad.returncode == 2 and name.encode() in bad.stderr, (arguments, bad)

heat = os.path.join(test.folder, "heat.png")
run = subprocess.run([ut.program("umbrage"), "aliasing", scene, "--size", "160x90", "--resolution", "512",
                      "--way", "lispsm", "-o", heat, "--json"], capture_output=True, timeout=120)

with test.check("`umbrage aliasing` says how many pixels a texel covers, for each way"):
    assert run.returncode == 0, run.stderr
    ways = {way["way"]: way for way in json.loads(run.stdout)["ways"]}
    assert sorted(ways) == ["lispsm", "scene", "slice", "uniform"]
    quiet = subprocess.run([ut.program("umbrage"), "aliasing", scene, "--size", "16x9", "--quiet"],
                           capture_output=True, timeout=120)
    assert quiet.returncode == 0 and quiet.stdout == quiet.stderr == b"", quiet
    for way in ways.values():
        assert sum(way["histogram"]) == way["points"] == sum(s["points"] for s in way["slices"]), way
    assert ways["scene"]["median"] <= ways["slice"]["median"], ways
    with open(heat, "rb") as png:
        assert png.read(8) == b"\x89PNG\r\n\x1a\n"

with test.check("twice the resolution halves the pixels of a texel"):
    twice = subprocess.run([ut.program("umbrage"), "aliasing", scene, "--size", "160x90",
                            "--resolution", "1022", "--json"], capture_output=True, timeout=120)
    fine = json.loads(twice.stdout)["ways"][0]
    assert abs(fine["median"] / ways["uniform"]["median"] - 0.5) < 1e-6, (fine, ways["uniform"])

with test.check("a lamp's maps are the faces of a cube and two paraboloids, each point in one of them"):
    run = subprocess.run([ut.program("umbrage"), "aliasing", scene, "--size", "160x90", "--resolution", "512", "--lamp",
                          "3,40,5", "-o", heat, "--json"], capture_output=True, timeout=120)
    assert run.returncode == 0, run.stderr
    lamp = {way["way"]: way for way in json.loads(run.stdout)["ways"]}
    assert sorted(lamp) == ["cube", "paraboloid"] and lamp["cube"]["points"] > 1000, lamp
    assert [len(lamp[way]["slices"]) for way in ("cube", "paraboloid")] == [6, 2], lamp
    for way in lamp.values():
        assert sum(way["histogram"]) == way["points"] == sum(s["points"] for s in way["slices"]), way
    assert lamp["cube"]["points"] == lamp["paraboloid"]["points"]
    assert lamp["cube"]["median"] < lamp["paraboloid"]["median"], lamp
    for words, says in ((("--lamp", "1,2"), b"--lamp"), (("--lamp", "1,2,3", "--way", "slice"), b"cube or paraboloid"),
                        (("--way", "cube"), b"--lamp")):
        refused = ut.run("umbrage-study", "aliasing", scene, "--size", "16x9", *words, code=2)
        assert says in refused.stderr, refused.stderr

with test.check("deep maps equal the products over all hits, with and without links"):
    run = subprocess.run([ut.program("umbrage-study"), "deep", scene, "--resolution", "128", "--size",
                          "80x50", "--epsilon", "0"], capture_output=True, timeout=120, text=True)
    assert run.returncode == 0, run.stderr
    assert "the same bits" in run.stdout, run.stdout
    worst = float(re.search(r"off by at most (\S+)", run.stdout)[1])
    assert worst < 1e-6, run.stdout

with test.check("an exponent only lights, and approaches the plain window as it grows"):
    run = subprocess.run([ut.program("umbrage"), "deep", scene, "--resolution", "128", "--size", "80x50", "--json"],
                         capture_output=True, timeout=120, text=True)
    filters = {row["name"]: row for row in json.loads(run.stdout)["filters"]}
    means = [filters[name]["window_mean"] for name in ("edsm-30", "edsm-100", "edsm-300", "edsm-1000")]
    assert means == sorted(means, reverse=True) and abs(means[3] - filters["pcf"]["window_mean"]) < 1e-3, means
    assert filters["texel"]["point_mean"] < filters["pcf"]["point_mean"], filters

with test.check("maps of moments are never too dark by more than they state, and nearer with more moments"):
    lists = os.path.join(test.folder, "lists.png")
    run = subprocess.run([ut.program("umbrage-study"), "deep", scene, "--resolution", "128", "--size", "80x50",
                          "--taps", "5", "-o", lists, "--json"], capture_output=True, timeout=120, text=True)
    assert run.returncode == 0, run.stderr
    moments = {row["name"]: row for row in json.loads(run.stdout)["moments"]}
    assert moments["moments-4"]["mean"] > moments["moments-6"]["mean"] > moments["moments-8"]["mean"], moments
    assert moments["moments-8-u16"]["mean"] > moments["moments-8"]["mean"], moments
    for name in ("moments-4", "moments-6", "moments-8", "moments-8-u16"):
        assert moments[name]["darker"] <= moments[name]["slack"], moments[name]
    with open(lists, "rb") as png:
        assert png.read(8) == b"\x89PNG\r\n\x1a\n"

with test.check("deep maps are told as JSON, and --quiet says nothing"):
    run = subprocess.run([ut.program("umbrage-study"), "deep", scene, "--resolution", "64", "--size", "40x25",
                          "--json"], capture_output=True, timeout=120, text=True)
    assert run.returncode == 0 and not run.stderr, run.stderr
    told = json.loads(run.stdout)
    assert told["resolution"] == 64 and told["points"] > 0 and told["same_bits"] is True, told
    assert 0 <= told["exact_error"] < 1e-6 and told["error"] < 0.01, told
    assert all(told[way]["bytes"] > 0 and told[way]["ns_per_point"] > 0
               for way in ("exact", "searched", "linked", "streamed")), told
    run = subprocess.run([ut.program("umbrage-study"), "deep", scene, "--resolution", "64", "--size", "40x25",
                          "-q"], capture_output=True, timeout=120, text=True)
    assert run.returncode == 0 and not run.stdout and not run.stderr, run

with test.check("pictures go to stdout for -o -, and what is said of them is talk"):
    for words in (["aliasing", scene, "--size", "16x9"],
                  ["techniques", scene, "--resolution", "64", "--size", "16x9"],
                  ["deep", scene, "--resolution", "64", "--size", "16x9"]):
        ut.run("umbrage-study", *words, "-o", picture, "--quiet")
        done = ut.run("umbrage-study", *words, "-o", "-")
        with open(picture, "rb") as png:
            assert done.stdout == png.read(), words
        assert scene.encode() in done.stderr, done.stderr
        done = ut.run("umbrage-study", *words, "-o", "-", "--json", code=2)
        assert b"--json: does not go with --output -" in done.stderr and not done.stdout, done
        with open("/dev/full", "wb") as full:
            done = subprocess.run([ut.program("umbrage-study"), *words, "-o", "-", "--quiet"], stdout=full, check=False)
        assert done.returncode == 74, done

test.finish()
