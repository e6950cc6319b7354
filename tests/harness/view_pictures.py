#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Pictures of the viewer by headless Chromium, for docs/pictures: an overview with an explained point, a phone in the dark,
the overlay while pages arrive, the split picture, leaves that are cut-outs, and a hall with a lamp.

    view_pictures.py CITY.umb CITY.glb HALL.umb HALL.glb GARDEN.umb GARDEN.glb FOLDER [PICTURE...]
"""
import os
import shutil
import sys
import tempfile

import devtools
import view_server

WAIT_S = 580
# Name, which asset, width, height, a phone, dark, the view, what happens before the picture.
PICTURES = [
    ("view.png", 0, 1400, 788, False, False, "#eye=-130,80,-110&target=5,5,5&fov=40", "explained"),
    ("view-split.png", 0, 976, 480, False, False, "#eye=-60,45,-60&target=10,5,10&fov=40&beside=cascades", "exact"),
    ("view-exact.png", 0, 900, 480, False, False, "#eye=60,75,90&target=20,5,40&fov=40&overlay=bound&move=walk", "turned"),
    ("view-phone.png", 1, 390, 760, True, True, "#eye=-20,6,3&target=0,2,0&move=walk", "exact"),
    ("view-hall.png", 1, 976, 548, False, False, "#eye=-15,4.5,9&target=0,1.5,0&fov=55", "exact"),
    ("view-garden.png", 2, 1200, 675, False, False, "#eye=14,5,-11&target=0,2.5,0&fov=45", "exact"),
]


def take(chromium, address, picture, folder):
    name, _, width, height, mobile, dark, view, moment = picture
    page = chromium.page(width, height, mobile, dark)
    page.open(address + view)
    page.wait("globalThis.umbrageViewer?.state.frames > 0", WAIT_S)
    page.wait("umbrageViewer.state.loading === 0 && umbrageViewer.state.exact === umbrageViewer.state.points", WAIT_S)
    if moment == "turned":  # The pages of the new view are not there yet
        page.call("Input.dispatchMouseEvent", type="mousePressed", x=520, y=200, button="left", buttons=1, clickCount=1)
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=300, y=200, button="left", buttons=1)
        drawn = page.evaluate("umbrageViewer.state.frames")
        page.wait(f"umbrageViewer.state.frames > {drawn}", WAIT_S)
    if moment == "explained":
        page.evaluate("umbrageViewer.explainAt(0.44, 0.62)")
    page.screenshot(os.path.join(folder, name))
    print(name, os.path.getsize(os.path.join(folder, name)), page.evaluate("document.getElementById('figures').textContent"))
    assert page.troubles == [], page.troubles


def main():
    assets, folder, chosen = (sys.argv[1:3], sys.argv[3:5], sys.argv[5:7]), sys.argv[7], sys.argv[8:]
    for picture in [each for each in PICTURES if not chosen or each[0] in chosen]:
        asset, scene = assets[picture[1]]
        view, profile = view_server.View(asset, "--scene", scene), tempfile.mkdtemp()
        try:
            with devtools.Chromium(profile, timeout=WAIT_S) as chromium:
                take(chromium, view.address, picture, folder)
        finally:
            view.close()
            shutil.rmtree(profile, ignore_errors=True)


if __name__ == "__main__":
    main()
