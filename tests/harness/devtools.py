# SPDX-License-Identifier: Apache-2.0
"""
Headless Chromium driven by the DevTools protocol over pipes.

    with devtools.Chromium(profile) as chromium:
        page = chromium.page(390, 844, mobile=True, dark=True)
        page.open("http://127.0.0.1:8080/")
        page.wait("globalThis.umbrageViewer?.state.ready", 30)
        assert page.troubles == []           # errors of the console and of the page
        page.screenshot("page.png")
"""
import base64
import json
import os
import select
import subprocess
import time

import web_browser


class Page:
    def __init__(self, chromium, session):
        self.chromium, self.session, self.troubles, self.requests = chromium, session, [], []
        self.fetched = []  # Addresses of which a byte came from a server, not from a cache

    def call(self, method, **words):
        return self.chromium.call(method, self.session, **words)

    def open(self, address):
        self.call("Page.navigate", url=address)

    def evaluate(self, code):
        """Value of an expression; a promise is awaited."""
        reply = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in reply:
            raise AssertionError(f"{code}: {json.dumps(reply['exceptionDetails'])[:600]}")
        return reply["result"].get("value")

    def wait(self, code, seconds):
        """Waits until an expression is true."""
        stop = time.monotonic() + seconds
        while not self.evaluate(f"Boolean({code})"):
            if time.monotonic() > stop:
                raise AssertionError(f"{code}: not within {seconds} s; {self.troubles}")
            time.sleep(0.1)

    def press(self, key, code, number=0, shift=False):
        """number: Windows' number of a key whose default the browser handles, such as 9 for Tab."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code, windowsVirtualKeyCode=number,
                      modifiers=8 if shift else 0)

    def click(self, x, y):
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def touch(self, *places):
        """One finger, from place to place."""
        for number, (x, y) in enumerate(places):
            self.call("Input.dispatchTouchEvent", type="touchStart" if number == 0 else "touchMove",
                      touchPoints=[{"x": x, "y": y}])
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def screenshot(self, path):
        data = self.call("Page.captureScreenshot", format="png")["data"]
        with open(path, "wb") as file:
            file.write(base64.b64decode(data))

    def take(self, method, words):
        """An event of the browser."""
        if method == "Runtime.exceptionThrown":
            self.troubles.append(words["exceptionDetails"].get("exception", {}).get("description", str(words)))
        elif method == "Runtime.consoleAPICalled" and words["type"] in ("error", "assert", "warning"):
            self.troubles.append(" ".join(str(one.get("value", one.get("description"))) for one in words["args"]))
        elif method == "Log.entryAdded" and words["entry"]["level"] == "error":
            self.troubles.append(f"{words['entry']['text']} {words['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.requests.append(words["request"]["url"])
        elif method == "Network.responseReceived" and not words["response"].get("fromDiskCache"):
            self.fetched.append(words["response"]["url"])


class Chromium:
    def __init__(self, profile, timeout=120):
        self.profile, self.timeout = profile, timeout
        self.number, self.pages, self.received, self.process = 0, {}, b"", None

    def __enter__(self):
        os.makedirs(self.profile, exist_ok=True)
        to_read, self.to = os.pipe()
        self.come, from_write = os.pipe()

        def place():  # Chromium reads from descriptor 3 and writes to 4
            low, high = os.dup(to_read), os.dup(from_write)
            os.dup2(low, 3)
            os.dup2(high, 4)

        with open(os.path.join(self.profile, "log"), "wb") as log:
            self.process = subprocess.Popen(  # pylint: disable=subprocess-popen-preexec-fn
                [web_browser.installed(), "--headless=new", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage",
                 "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
                 "--remote-debugging-pipe", f"--user-data-dir={self.profile}", "about:blank"],
                preexec_fn=place, close_fds=False, stdout=log, stderr=log)
        os.close(to_read)
        os.close(from_write)
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(20)
        os.close(self.to)
        os.close(self.come)

    def _receive(self):
        while b"\0" not in self.received:
            if not select.select([self.come], [], [], self.timeout)[0]:
                raise AssertionError("Chromium does not answer")
            part = os.read(self.come, 1 << 20)
            if not part:
                raise AssertionError("Chromium ended")
            self.received += part
        message, self.received = self.received.split(b"\0", 1)
        return json.loads(message)

    def call(self, method, session=None, **words):
        self.number += 1
        message = {"id": self.number, "method": method, "params": words, **({"sessionId": session} if session else {})}
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._receive()
            if reply.get("id") == self.number:
                if "error" in reply:
                    raise AssertionError(f"{method}: {reply['error']}")
                return reply["result"]
            if reply.get("sessionId") in self.pages:
                self.pages[reply["sessionId"]].take(reply["method"], reply["params"])

    def page(self, width, height, mobile=False, dark=False):
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = self.pages[session] = Page(self, session)
        for domain in ("Page", "Runtime", "Log", "Network"):
            page.call(f"{domain}.enable")
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        page.call("Emulation.setTouchEmulationEnabled", enabled=mobile)
        page.call("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        return page
