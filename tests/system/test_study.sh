#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The study of what accuracy costs: its files, that errors are reproducible and fall with the voxel,
# suns and lamps, closed scenes and open ones.
. "$(dirname "$0")/../harness/umbrage_test.sh"

cd "$folder" || exit 1
limit=600 # a study takes its times again where a machine is busy
"$BUILD/scenegen" city --size 4 -o city.glb 2>/dev/null
set -- --quick --max-resolution 1024 --points 1000 --truth 4
try 0 umbrage-study city.glb -o first "$@" --json
cp out first.json

# The results of two runs must be equal except for times.
cat >same.py <<'PY'
import json, sys
a, b = (json.load(open(p)) for p in sys.argv[1:3])
timed = {"ns_view", "ns_free", "ns_view_all", "spread", "spread_free", "spread_all", "build_s", "instructions"}
strip = lambda rows: [{k: v for k, v in r.items() if k not in timed} for r in rows]
assert strip(a["results"]) == strip(b["results"]), "errors differ"
assert a["samples"] == b["samples"] and a["samples"]["view"] >= 900 and a["samples"]["free"] == 1000
PY
check "--json prints the report" cmp -s first.json first/report.json

cat >falls.py <<'PY'
import csv, json
report = json.load(open("first/report.json"))
rows = list(csv.DictReader(open("first/report.csv")))
assert len(rows) == len(report["results"])
count = lambda method: sum(r["method"] == method for r in report["results"])
assert count("dag") == 2 * 2 * (3 + 1) and count("penumbra") == 2, report["results"]
assert count("tent") == count("footprint") == 4
assert sum(r["method"].startswith("derived") for r in report["results"]) == 5
for closed in (True, False):
    for taps in (1, 3, 9):
        ladder = [(report["bakes"][r["bake"]], r) for r in report["results"]
                  if r["method"] == "dag" and r["taps"] == taps and r["level"] == 0 and report["bakes"][r["bake"]]["closed"] == closed]
        assert len(ladder) == 2
        for what in (lambda b, r: b["voxel_m"], lambda b, r: r["wrong"], lambda b, r: r["off_mean_m"]):
            values = [what(b, r) for b, r in ladder]
            # A window that reaches into a solid is left out; at a higher resolution there are fewer
            # of these.
            left_out = [r["undefined"] / r["judged"] for _, r in ladder]
            assert values[1] < values[0] or left_out[0] > left_out[1] and "Not monotone" in report["verdict"], (taps, closed, values)
        # Where one tap is wrong, the true edge is within the distance of a voxel and its bias, on a
        # slope.
        if taps == 1:
            assert all(r["off_p99_m"] < 6 * b["voxel_m"] for b, r in ladder), ladder
samples = report["samples"]["view"] + report["samples"]["border"]
for r in report["results"]:
    assert r["judged"] + r["undefined"] == samples
    assert r["judged"] > 1000 and 0 < r["rms"] < 0.3 and r["memory_bytes"] > 0 and r["truth_error"] < 0.1, r
    # Errors are means over all samples, 0 where the answer is right: if less than 1 % are wrong,
    # the 99th percentile is 0.
    assert abs(r["wrong"] - r["false_light"] - r["false_shadow"] - r["undecided"]) < 1e-5, r
    assert (r["off_p99_m"] == 0) == (r["wrong"] <= 0.01) and (r["off_p95_m"] == 0) == (r["wrong"] <= 0.05), r
    assert r["off_mean_m"] <= r["wrong"] * r["off_max_m"] <= report["reach_m"] and r["wrong_view"] < r["wrong_border"], r
    assert r["nodes"] > 0 or r["method"] not in ("dag", "penumbra", "tent", "footprint")
    for name in ("ns_view", "ns_free", "ns_view_all"):
        assert r[name] > 0, r # every time is told
assert len(report["uncounted"]) > 10 or all(r["instructions"] > 10 for r in report["results"])
first = report["verdict"].split("\n")[0]
assert first.startswith("1024 voxels a side instead of 512: ") and "wrong" in first and "time of a look-up" in first, first
PY
check "errors fall with the voxel" /usr/bin/python3 falls.py

cat >techniques.py <<'PY'
import json, os
report = json.load(open("first/report.json"))
rows = report["techniques"]["rows"]
techniques = {(t["name"], t["truth"]): t for t in rows}
assert len(techniques) == len(rows) > 40
assert 0 < techniques["pcf-f32", "box"]["mean"] < techniques["vsm", "box"]["mean"], techniques
assert techniques["dag 1024-closed", "box"]["dag"] and 0 < techniques["dag 1024-open", "box"]["mean"] < 0.05
assert techniques["dag 1024-open", "disc"]["mean"] < techniques["pcss", "disc"]["mean"]
assert report["techniques"]["resolution"] == 512
for t in rows:
    assert t["ns"] > 0 and os.path.exists(f"first/pictures/technique-{t['name'].replace(' ', '-')}-{t['truth']}.png"), t
    if t["dag"]:
        assert t["ns_scalar"] is None if t["truth"] == "disc" else t["ns_scalar"] > t["ns"] / 2, t
        continue
    # A map stands beside the asset with as many texels, and beside the finest asset with no more
    # bytes.
    same, bytes_ = rows[t["same_texels"]], rows[t["same_bytes"]]
    assert same["dag"] and same["resolution"] == 512 and same["truth"] == t["truth"], (t, same)
    fits = [r["resolution"] for r in rows if r["dag"] and r["truth"] == t["truth"] and r["bytes"] <= t["bytes"]]
    assert (bytes_["dag"] and bytes_["resolution"] == max(fits)) if fits else t["same_bytes"] == -1, t
PY
check "techniques stand beside equal texels and equal bytes" /usr/bin/python3 techniques.py

# The shadow map and the volume have the voxels of the open asset, so they err where it errs.
cat >peers.py <<'PY'
import json
report = json.load(open("first/report.json"))
errors = ("rms", "worst", "over_01", "wrong", "wrong_border", "false_light", "false_shadow", "off_mean_m", "off_unknown")
ours = {(r["bake"], r["taps"]): r for r in report["results"] if r["method"] == "dag" and r["level"] == 0}
peers = [r for r in report["results"] if r["method"] in ("depth map", "nanovdb")]
for r in peers:
    dag = ours[r["bake"], r["taps"]]
    assert not report["bakes"][r["bake"]]["closed"]
    # The peer's samples were moved beforehand and are floats, so a few may fall into another texel.
    assert all(abs(r[k] - dag[k]) <= 1e-3 + 0.01 * dag[k] for k in errors), (r, dag)
    assert r["memory_bytes"] > dag["memory_bytes"], (r, dag)
methods = {r["method"] for r in peers}
assert methods == {"depth map", "nanovdb"} or len(report["missing"]) > 20, methods
assert "A plain depth map" in report["verdict"] or report["missing"] in report["verdict"]
PY
check "the peers of the same voxels have the same errors" /usr/bin/python3 peers.py

check "the page holds the data and the pictures" sh -c '
    ! grep -q "@DATA@\|@PICTURES@" first/report.html &&
    [ "$(grep -c "data:image/png;base64," first/report.html)" -eq $((2 + 2 * 4 + 3 + $(grep -o "same_texels" first/report.json | wc -l))) ] &&
    ! grep -qE "(src|href)=\"(https?:)?//" first/report.html'
if command -v node >/dev/null; then
    check "its scripts run" sh -c 'node "$1/tests/harness/draw_page.js" first/report.html >drawn.json' sh "$root"
    cat >drawn.py <<'PY'
import json
ids = json.load(open("drawn.json"))["ids"]
report = json.load(open("first/report.json"))


def below(node):
    yield node
    for child in node["children"]:
        yield from below(child)


for place, least in (("charts", 4), ("technique-charts", 2)):
    assert len(ids[place]["children"]) == least, place
    for figure in ids[place]["children"]:
        kinds = [n["tag"] for n in below(figure)]
        assert kinds.count("circle") > 5 and kinds.count("text") > 5, (place, kinds)
        front = next(n for n in below(figure) if n["attributes"].get("class") == "front")
        assert "," in front["attributes"]["points"] and "NaN" not in front["attributes"]["points"]
box = [t for t in report["techniques"]["rows"] if t["truth"] == "box"]
steps = [r for r in report["results"] if r["method"] == "dag" and r["taps"] == 1 and r["level"] == 0]
for table, rows in (("settings", report["results"]), ("techniques", box), ("assets", report["bakes"]), ("steps", steps)):
    found = [n for n in below(ids[table]) if n["tag"] == "tr"]
    assert len(found) == 1 + len(rows), (table, len(found))
assert ids["lead"]["text"].startswith("1024 voxels a side instead of 512:"), ids["lead"]
# The legend has what was measured, and marks have labels.
legend = ids["legend"]["text"]
methods = {r["method"] for r in report["results"]}
for words, there in (("closed asset", True), ("open asset", True), ("NanoVDB", "nanovdb" in methods), ("plain depth map", "depth map" in methods),
                     ("tent", True), ("coarse level", True)):
    assert (words in legend) == there, (words, legend)
labels = [n["text"] for n in below(ids["charts"]["children"][0]) if n["attributes"].get("class") == "label"]
# A label is left out where it would cover a mark, which depends on measured times.
assert {"512", "1024"} & set(labels) and len(labels) > 4, labels
PY
    check "they draw every chart and list every setting" /usr/bin/python3 drawn.py
else
    left_out "scripts of the study's page" "node is not installed"
fi
browser=$(command -v chromium || true)
if [ -n "$browser" ]; then
    timeout 300 "$browser" --headless --no-sandbox --disable-gpu --enable-logging=stderr --virtual-time-budget=2000 \
        --dump-dom "file://$PWD/first/report.html" >dom 2>log || true
    same "a browser finds no error" "" "$(grep -E 'Uncaught|CONSOLE.*(E|e)rror' log)"
    check "a browser draws every chart" [ "$(grep -o '<svg' dom | wc -l)" -ge 4 ]
    # Each mark must have a sentence that says what it is, with its units.
    { cat first/report.html; cat <<'PAGE'
<script>
const dots = [...document.querySelectorAll("#charts .dot")];
const told = dots.filter(dot => {
  dot.dispatchEvent(new MouseEvent("mouseenter"));
  const text = tip.style.display === "block" ? tip.textContent : "";
  return /wrong: .* of what cameras see.*ns a point.* MB in memory/s.test(text) && dot.getAttribute("aria-label") === text;
});
document.title = `told ${told.length === dots.length && dots.length > 50} fronts ` +
  `${[...document.querySelectorAll("#charts .front")].every(line => line.getAttribute("points").includes(","))}`;
</script>
PAGE
    } >first/hover.html
    timeout 300 "$browser" --headless --no-sandbox --disable-gpu --virtual-time-budget=2000 \
        --dump-dom "file://$PWD/first/hover.html" >hover 2>/dev/null || true
    check "a browser explains every mark and draws the fronts" grep -q "<title>told true fronts true</title>" hover
    check "a browser lists every setting" [ "$(grep -o '<tr' dom | wc -l)" -gt 65 ]
fi

# A scene that the plan leaves open has each asset once, and the output does not mention closed
# ones.
"$BUILD/scenegen" arch --size 3 -o arch.glb 2>/dev/null
try 0 umbrage-study arch.glb -o open "$@" --point 2,6,3 --quiet
cat >once.py <<'PY'
import json
report = json.load(open("open/report.json"))
assert not any(b["closed"] for b in report["bakes"]), report["bakes"]
assert [b["resolution"] for b in report["bakes"]] == [512, 1024]
assert len({b["asset"] for b in report["bakes"]}) == 2
keys = [(r["method"], r["taps"], r["level"], report["bakes"][r["bake"]]["resolution"]) for r in report["results"]]
assert len(keys) == len(set(keys)), "a setting is there twice"
PY
check "an open scene has each asset once" /usr/bin/python3 once.py

# A lamp: by the command line and by a file's light, near the houses. An earlier run's assets are taken
# only if they are of this scene and this light.
stamp() { stat -c %Y.%i city-study/assets/512-auto.umb; }
mkdir city-study
mv first/assets city-study/
before=$(stamp)
try 0 umbrage-study city.glb -o city-study "$@" --point 10,40,-10
check "an asset of another light is baked again" [ "$before" != "$(stamp)" ]
cp -R city-study lamp
before=$(stamp)
try 0 umbrage study city.glb "$@" --point 10,40,-10 --quiet # into city-study
check "--quiet says nothing" test ! -s out -a ! -s err
same "an asset that is there is not baked again" "$before" "$(stamp)"
check "two runs agree in every error" /usr/bin/python3 same.py lamp/report.json city-study/report.json
small="--max-resolution 512 --quiet"
"$BUILD/scenegen" city --size 4 --seed 9 -o city.glb 2>/dev/null
try 0 umbrage-study city.glb "$@" $small --point 10,40,-10
check "an asset of another scene is baked again" [ "$before" != "$(stamp)" ]

cat >lamp.py <<'PY'
import json, sys
report = json.load(open(f"{sys.argv[1]}/report.json"))
assert report["light"]["lamp"] and not report["techniques"]["rows"]
dag = [(report["bakes"][r["bake"]], r) for r in report["results"] if r["method"] == "dag" and r["level"] == 0 and r["taps"] == 1]
for closed in {b["closed"] for b, _ in dag}:
    ladder = [(b, r) for b, r in dag if b["closed"] == closed]
    assert len(ladder) == 2 and ladder[0][1]["wrong"] > ladder[1][1]["wrong"] > 0, ladder
    assert abs(ladder[0][0]["voxel_m"] / ladder[1][0]["voxel_m"] - 2) < 0.1 # frusta have a border of some texels
    for b, r in ladder:
        assert r["wrong_view"] < 0.1 and r["rms"] < 0.3 and r["off_mean_m"] < b["voxel_m"] and r["ns_view"] > 0, (b, r)
assert {r["method"] for r in report["results"]} <= {"dag", "footprint", "tent", "penumbra"}
assert "directional lights only" in report["missing"] and report["missing"] in report["verdict"]
assert report["rays"]["ns_view"] > 0 and report["rays"]["ns_view8"] is None
PY
check "a lamp is studied" /usr/bin/python3 lamp.py lamp
check "with pictures" test -s lamp/pictures/traced.png -a -s lamp/pictures/1024-closed-9-difference.png
if command -v node >/dev/null; then
    check "its page's scripts run" sh -c 'node "$1/tests/harness/draw_page.js" lamp/report.html >drawn.json' sh "$root"
fi
# A file with three lamps: the first is studied, and it alone is baked.
cat >lamps.py <<'PY'
import json, struct
body = open("city.glb", "rb").read()
length, = struct.unpack_from("<I", body, 12)
gltf = json.loads(body[20:20 + length])
lights = [{"type": "point", "name": f"lamp {i}"} for i in range(3)]
gltf.setdefault("extensions", {})["KHR_lights_punctual"] = {"lights": lights}
gltf["extensionsUsed"] = gltf.get("extensionsUsed", []) + ["KHR_lights_punctual"]
for i in range(3):
    gltf["scenes"][0]["nodes"].append(len(gltf["nodes"]))
    gltf["nodes"].append({"name": f"lamp {i}", "translation": [10.0, 40.0 + i, 10.0], "extensions": {"KHR_lights_punctual": {"light": i}}})
text = json.dumps(gltf).encode()
text += b" " * (-len(text) % 4)
rest = body[20 + length:]
open("lamps.glb", "wb").write(struct.pack("<III", 0x46546C67, 2, 20 + len(text) + len(rest)) +
                              struct.pack("<II", len(text), 0x4E4F534A) + text + rest)
PY
/usr/bin/python3 lamps.py
try 0 umbrage-study lamps.glb -o three "$@" $small
check "the first of three lamps is studied" /usr/bin/python3 -c '
import json
light = json.load(open("three/report.json"))["light"]
assert light["lamp"] and light["name"] == "lamp 0" and light["position"][1] == 40, light'
out_lights=$("$BUILD/umbrage" info three/assets/512-auto.umb --json 2>/dev/null | grep -o '"kind"' | wc -l)
same "it alone is baked" 1 "$out_lights"

# Translucent casters: the asset's transmittance is compared with rays through the panes.
/usr/bin/python3 -c 'import sys; sys.path.insert(0, sys.argv[1]); import translucent_scenes; translucent_scenes.glass("glass.obj")' "$root/tests/harness"
try 0 umbrage-study glass.obj -o glass "$@" --up z --quiet
cat >glass.py <<'PY'
import json
report = json.load(open("glass/report.json"))
assert report["translucent"] and "Translucent casters let light through" in report["verdict"]
assert "effect=transmittance state=on" in report["plan"]
one = [r for r in report["results"] if r["method"] == "dag" and r["taps"] == 1 and r["level"] == 0]
assert one and one[-1]["wrong"] < one[0]["wrong"], one
for r in report["results"]:
    if r["method"] == "dag" and r["level"] == 0:
        assert r["wrong_view"] < 0.03 and r["rms"] < 0.15, r
PY
check "translucent casters are judged by what they let through" /usr/bin/python3 glass.py

# What it refuses.
try 2 umbrage-study city.glb -o x --points 10
one_sentence --points
try 2 umbrage-study nonsense -o x
one_sentence nonsense
try 66 umbrage-study missing.glb -o x
one_sentence missing.glb
try 2 umbrage-study city.glb -o x --sun 400,400,1 --quick --quiet
one_sentence --sun
try 2 umbrage-study city.glb -o x --point 1,2 --quick --quiet
one_sentence --point
try 2 umbrage-study city.glb -o x --point 1,2,3 --sun 135,40 --quiet
one_sentence --point
try 73 umbrage-study city.glb -o no/such/folder --quiet
one_sentence no/such/folder
finish
