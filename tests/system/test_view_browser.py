#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The page of `umbrage view` in headless Chromium: it opens without a complaint, becomes exact, explains a point as
`umbrage query --explain` does, works by keys and by touch, on the width of a phone, in light and dark.
"""
import os
import re
import shutil
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import devtools  # noqa: E402
import page_access  # noqa: E402
import umbrage_test as ut  # noqa: E402
import view_server  # noqa: E402
import web_browser  # noqa: E402
import web_cases  # noqa: E402

web_cases.need_package()
if web_browser.installed() is None:
    ut.skip("chromium is not installed")
if not os.path.exists("/usr/share/javascript/three/build/three.module.js"):
    ut.skip("three.js is not installed: libjs-three")
test = ut.Test()
scene, asset = test.scene("city", 6), test.path("city.umb")
ID = test.bake(scene, asset, "--resolution", 2048, "--sun", "135,40", "--sun", "200,55", "--verify", 0)["asset"]
WAIT_S = 90  # Chromium draws in software here, beside other tests
EXACT = "umbrageViewer.state.loading === 0 && umbrageViewer.state.points > 0 && " \
    "umbrageViewer.state.exact === umbrageViewer.state.points"


def explained(point, normal, taps, light):
    """What `umbrage query --explain` prints for a point."""
    line = " ".join(repr(each) for each in point + normal)
    done = ut.run("umbrage", "query", asset, "--points", "-", "--taps", taps, "--light", light, "--explain", "--quiet",
                  stdin=line.encode())
    return done.stdout.decode().rstrip("\n")


def same(ours, theirs):
    """The path through the tree and its cost are those of the layout, which differs between a part and a whole file."""
    ours, theirs = ("\n".join(line for line in text.split("\n") if not line.startswith(("  level", "  cost")))
                    for text in (ours, theirs))
    assert ours == theirs, f"the page says\n{ours}\nthe command says\n{theirs}"


# The page, and beside it the example of docs/guide/web.md.
os.mkdir(test.path("bin"))
shutil.copy(ut.program("umbrage"), test.path("bin"))
for name in ("umbrage", "viewer"):
    shutil.copytree(os.path.join(ut.BUILD, "web", name), test.path("bin", "web", name))
shutil.copy(os.path.join(ut.ROOT, "docs", "examples", "three.html"), test.path("bin", "web", "viewer"))
view = view_server.View(asset, "--scene", scene, program=test.path("bin", "umbrage"))
with devtools.Chromium(test.path("profile")) as chromium:
    page = chromium.page(640, 300)
    with test.check("the page opens, and its figures become exact"):
        page.open(view.address)
        page.wait("globalThis.umbrageViewer?.state.ready || globalThis.umbrageViewer?.state.error", WAIT_S)
        page.wait(EXACT, WAIT_S)
        figures = page.evaluate("document.getElementById('figures').textContent")
        assert "exact 100 % of the points" in figures and "bound 1" in figures, figures
    with test.check("a click explains a point as the command line does"):
        page.evaluate("umbrageViewer.explainAt(0.5, 0.6)")
        picked = page.evaluate("umbrageViewer.state.picked")
        assert picked["is_exact"], picked
        same(picked["text"], explained(picked["point"], picked["normal"], 9, 0))
        assert page.evaluate("!document.getElementById('answer').hidden")
    with test.check("keys change window, light and overlay; another light becomes exact too"):
        for key, code in (("[", "BracketLeft"), (".", "Period"), ("o", "KeyO")):
            page.press(key, code)
        values = page.evaluate("['taps', 'light', 'overlay', 'sun'].map((name) => document.getElementById(name).value)")
        assert values == ["7", "1", "exact", "1"], values
        page.wait(EXACT, WAIT_S)
        page.evaluate("umbrageViewer.explainAt(0.4, 0.55)")
        picked = page.evaluate("umbrageViewer.state.picked")
        same(picked["text"], explained(picked["point"], picked["normal"], 7, 1))
    with test.check("the split picture: cascades beside it, the border moves by keys, and both sides tell their bytes"):
        page.press("o", "KeyO")
        page.press("o", "KeyO")
        page.press("c", "KeyC")
        page.wait("umbrageViewer.parts.cascades !== null && !document.getElementById('split-view').hidden", 10)
        page.evaluate("document.getElementById('split').focus()")
        page.press("ArrowRight", "ArrowRight", 39)
        page.wait("document.getElementById('split').value === '501' && " + EXACT, WAIT_S)
        texts = page.evaluate("['ours', 'theirs'].map((id) => document.getElementById(id).textContent)")
        assert "MB, 4 maps of 2048 x 2048" in texts[1] and re.match(r"umbrage: \d+ kB, .* sent to the GPU", texts[0]), texts
        sides = view_server.read_sides(page)
        theirs = [share for share in sides.shares[1::2] if 0 <= share <= 1]
        same_side = sum((ours > 0.5) == (share > 0.5) for ours, share in zip(sides.shares[::2], sides.shares[1::2]))
        assert len(theirs) == len(sides.shares) // 2 and 0.85 < same_side / len(theirs) < 1, (same_side, len(theirs))
    with test.check("controls have roles and names, texts have contrast, Tab reaches all and is not trapped"):
        page_access.check_names(page)
        page_access.check_contrast(page)
        page_access.check_focus(page)
    source = page_access.axe(test.path("axe"))
    if source is None:
        ut.left_out("axe on the viewer", "npm's registry cannot be reached")
    else:
        with test.check("axe finds nothing"):
            page_access.check_axe(page, source)
    page.press("c", "KeyC")
    with test.check("a reload takes the asset's pages from the browser's cache"):
        before, already = len(page.requests), len(page.fetched)
        page.call("Page.reload")
        page.wait("globalThis.umbrageViewer?.state.frames > 0", WAIT_S)
        page.wait(EXACT, WAIT_S)
        asked = [url for url in page.requests[before:] if f"asset-{ID}" in url]
        again = [url for url in page.fetched[already:] if f"asset-{ID}" in url]
        assert asked and not again, (asked, again)
    with test.check("every request went to its own server, and nothing complained"):
        assert all(url.startswith((view.address, "blob:", "data:")) for url in page.requests), page.requests
        assert page.troubles == [], page.troubles
    with test.check("the example: shadows of the asset beside a shadow map of three.js"):
        page.call("Page.setBypassCSP", enabled=True)  # It has a script of its own, which the viewer's server does not allow
        page.open(f"{view.address}three.html?asset=asset-{ID}.umb&scene=scene/{os.path.basename(scene)}")
        page.wait("globalThis.frames_drawn > 1", WAIT_S)
        page.wait("/^\\d+ kB fetched$/.test(document.getElementById('figures').textContent)", WAIT_S)
        assert page.troubles == [], page.troubles
        page.open("about:blank")  # It would be drawn on
    phone = chromium.page(390, 844, mobile=True, dark=True)
    with test.check("on a phone, in the dark: touch turns the picture, nothing is wider than the screen"):
        phone.open(view.address + "#move=walk")
        phone.wait("globalThis.umbrageViewer?.state.ready", WAIT_S)
        phone.wait(EXACT, WAIT_S)
        assert phone.evaluate("document.documentElement.scrollWidth") <= 390
        before = phone.evaluate("umbrageViewer.state.direction")
        phone.touch((200, 300), (150, 300), (100, 300))
        phone.wait(f"umbrageViewer.state.direction !== {before!r}", 10)
        assert phone.evaluate("!document.getElementById('pad').hidden")
        phone.evaluate("document.getElementById('panel').open = true")
        page_access.check_contrast(phone)
        ground = phone.evaluate("getComputedStyle(document.body).backgroundColor")
        assert ground == "rgb(17, 23, 29)" and phone.troubles == [], (ground, phone.troubles)
view.close()
test.finish()
