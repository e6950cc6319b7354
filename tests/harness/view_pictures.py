#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Pictures of the viewer by headless Chromium, for docs/pictures: an overview with an explained point, a phone in the dark,
and the overlay while pages arrive.

    view_pictures.py CITY.umb CITY.glb HALL.umb HALL.glb FOLDER
"""
import os
import shutil
import sys
import tempfile

import devtools
import view_server

CITY = "#eye=60,52,90&target=-30,5,-50&fov=45"
WAIT_S = 580
# Name, which asset, width, height, a phone, dark, the view, what happens before the picture.
PICTURES = [
    ("view-exact.png", 0, 1000, 620, False, False, CITY + "&overlay=bound", "arriving"),
    ("view-phone.png", 1, 390, 760, True, True, "#eye=-20,6,3&target=0,2,0&move=walk", "exact"),
    ("view.png", 0, 1400, 560, False, False, CITY, "explained"),
]


def take(chromium, address, picture, folder):
    name, _, width, height, mobile, dark, view, moment = picture
    page = chromium.page(width, height, mobile, dark)
    page.open(address + view)
    page.wait("globalThis.umbrageViewer?.state.frames > 0", WAIT_S)
    if moment == "arriving":
        page.evaluate("umbrageViewer.state.frame_ms = 0")  # In software the page would wait for all pages
        page.wait("umbrageViewer.state.frames > 1", WAIT_S)
    else:
        page.wait("umbrageViewer.state.loading === 0 && umbrageViewer.state.exact === umbrageViewer.state.points", WAIT_S)
    if moment == "explained":
        page.evaluate("umbrageViewer.explainAt(0.44, 0.62)")
    page.screenshot(os.path.join(folder, name))
    print(name, os.path.getsize(os.path.join(folder, name)), page.evaluate("document.getElementById('figures').textContent"))
    assert page.troubles == [], page.troubles


def main():
    assets, folder = (sys.argv[1:3], sys.argv[3:5]), sys.argv[5]
    for picture in PICTURES:
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
