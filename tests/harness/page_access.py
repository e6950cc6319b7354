# SPDX-License-Identifier: Apache-2.0
"""
Accessibility of a page in headless Chromium: names and roles of its controls, contrast of its texts, and the way of the Tab
key. axe runs too where npm's registry can be reached.
"""
import os
import subprocess

import umbrage_test as ut

# What the browser tells assistive programs of each kind of control, and of the picture.
ROLES = {"button", "combobox", "slider", "DisclosureTriangle", "image", "generic", "link", "textbox", "checkbox"}


def measure(page):
    with open(os.path.join(ut.ROOT, "tests", "web", "accessibility.js"), encoding="utf-8") as file:
        return page.evaluate(file.read())


def check_names(page):
    """Every node that takes the focus has a role, and a name unless it is a region that scrolls."""
    nodes = page.call("Accessibility.getFullAXTree")["nodes"]
    focusable = [node for node in nodes if not node["ignored"] and any(
        one["name"] == "focusable" and one["value"]["value"] for one in node.get("properties", []))]
    focusable = [node for node in focusable if node["role"]["value"] not in ("RootWebArea", "menuitem", "option", "MenuListOption")]
    assert len(focusable) > 5, focusable
    for node in focusable:
        role, name = node["role"]["value"], node.get("name", {}).get("value", "")
        assert role in ROLES and (name.strip() or role == "generic"), (role, name)


def check_contrast(page):
    pale = measure(page)["pale"]
    assert pale == [], pale


def check_focus(page):
    """Tab reaches every control once, in the order of the page, and leaves again; Shift with Tab goes back."""
    controls = measure(page)["controls"]
    at = "document.activeElement?.dataset.reach ?? ''"
    page.evaluate("document.body.tabIndex = -1, document.body.focus()")  # The way begins before the first control
    forth, back = [], []
    for _ in range(len(controls) + 1):
        page.press("Tab", "Tab", 9)
        forth.append(page.evaluate(at))
    wanted = [str(number) for number in range(len(controls))]
    assert forth[:-1] == wanted and forth[-1] in ("", "0"), (forth, controls)
    page.evaluate(f"document.querySelector('[data-reach=\"{len(controls) - 1}\"]').focus()")
    for _ in range(len(controls) - 1):
        page.press("Tab", "Tab", 9, shift=True)
        back.append(page.evaluate(at))
    assert back == wanted[-2::-1], (back, controls)


def axe(folder):
    """Source of axe, or None: it is in npm's registry only."""
    os.makedirs(folder, exist_ok=True)
    try:
        done = subprocess.run(["npm", "install", "--no-save", "--no-audit", "--no-fund", "--fetch-retries=0", "--fetch-timeout=5000",
                               "axe-core@4"], cwd=folder, check=False, capture_output=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return None
    path = os.path.join(folder, "node_modules", "axe-core", "axe.min.js")
    if done.returncode != 0 or not os.path.exists(path):
        return None
    with open(path, encoding="utf-8") as file:
        return file.read()


def check_axe(page, source):
    page.evaluate(f"{source}; 0")
    found = page.evaluate("axe.run().then(({ violations }) => violations.map(({ id, nodes }) => "
                          "`${id}: ${nodes.map(({ html }) => html.slice(0, 80))}`))")
    assert found == [], found
