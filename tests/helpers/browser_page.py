"""A page in a browser without a window, driven through pipes by the DevTools protocol.

Messages are JSON, each ended by a zero byte: what `--remote-debugging-pipe` is for.
"""

import base64
import io
import json
import os
import select
import subprocess
import time

import numpy as np
from PIL import Image

FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    "--host-resolver-rules=MAP * ~NOTFOUND",  # no network
)
_PATIENCE = 90.0  # [s], on a busy machine


class BrowserPage:
    """One page: what it shows, what it complained about, its buttons and its slider.

    Attributes:
        complaints: Errors and warnings of its scripts and of its console.
    """

    def __init__(self, browser, folder):
        """Start a browser, its profile in a folder."""
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        self.complaints = []
        self._buffer, self._number, self._session = b"", 0, None
        command = [browser, *FLAGS, f"--user-data-dir={folder}", "--remote-debugging-pipe"]
        # Chromium reads from 3 and writes to 4; by name, since shells redirect single digits only.
        shell = f'exec "$@" 3</dev/fd/{to_browser} 4>/dev/fd/{from_browser}'
        self._process = subprocess.Popen(
            ["sh", "-c", shell, "sh", *command, "about:blank"],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self._ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._ask(f"{domain}.enable")

    def close(self):
        """End the browser."""
        self._session = None
        try:
            self._ask("Browser.close")
        except (OSError, AssertionError):
            self._process.kill()
        self._process.wait(30)
        os.close(self._read)
        os.close(self._write)

    def open(self, url, width, height):
        """Open an address in a window of so many pixels, and wait until the page is drawn."""
        self.resize(width, height)
        self._ask("Page.navigate", url="about:blank")  # else another time alone loads nothing
        self._ask("Page.navigate", url=url)
        ready = "document.readyState === 'complete' && typeof viewer !== 'undefined' && !!viewer"
        self.wait(f"{ready} && byId('views').children.length > 3")
        self.settle()

    def resize(self, width, height):
        """Give the window so many pixels."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._ask("Emulation.setDeviceMetricsOverride", **size)

    def run(self, script):
        """Return what an expression of JavaScript gives, promises awaited."""
        answer = self._ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, f"{script}: {answer['exceptionDetails']}"
        return answer["result"].get("value")

    def wait(self, condition):
        """Wait until an expression is true."""
        end = time.monotonic() + _PATIENCE
        while not self.run(f"Boolean({condition})"):
            assert time.monotonic() < end, f"{condition} did not become true"
            time.sleep(0.05)

    def settle(self):
        """Wait until the page has drawn two more pictures."""
        frame = "requestAnimationFrame"
        self.run(f"new Promise((done) => {frame}(() => {frame}(() => done(1))))")

    def press(self, selector):
        """Click in the middle of an element."""
        x, y = self.run(
            f"(({{left, top, width, height}}) => [left + width / 2, top + height / 2])"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)
        self.settle()

    def mouse(self, kind, x, y):
        """Press, move (with the button down) or release the mouse."""
        more = {} if kind == "mouseMoved" else {"clickCount": 1}
        self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, **more)

    def drag(self, selector, begin, end):
        """Drag along an element, from one fraction of its width to another."""
        left, y, width = self.run(
            f"(({{left, top, width, height}}) => [left, top + height / 2, width])"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        self.mouse("mousePressed", left + begin * width, y)
        for fraction in np.linspace(begin, end, 4):
            self.mouse("mouseMoved", left + fraction * width, y)
        self.mouse("mouseReleased", left + end * width, y)
        self.settle()

    def hover(self, x, y):
        """Point somewhere with no button down."""
        self._ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        self.settle()

    def picture(self):
        """Return what is seen, shape (height, width, 3), 0 to 255."""
        self.settle()
        shot = base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"])
        with Image.open(io.BytesIO(shot)) as image:
            return np.asarray(image.convert("RGB")).astype(int)

    def printed(self):
        """Return the page as it is printed, PDF."""
        settings = {"preferCSSPageSize": True, "printBackground": True}
        return base64.b64decode(self._ask("Page.printToPDF", **settings)["data"])

    def _ask(self, method, **parameters):
        """Return the answer to a command; note what the page complains of meanwhile."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            self._note(answer)
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def _next(self):
        end = time.monotonic() + _PATIENCE
        while b"\0" not in self._buffer:
            left = end - time.monotonic()
            assert left > 0 and select.select([self._read], [], [], left)[0], "no answer"
            more = os.read(self._read, 1 << 20)
            assert more, "the browser has ended"
            self._buffer += more
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _note(self, message):
        found = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(found["exceptionDetails"]))
        if message.get("method") == "Runtime.consoleAPICalled" and found["type"] == "error":
            self.complaints.append(str(found["args"]))
        if message.get("method") == "Log.entryAdded" and found["entry"]["level"] == "error":
            self.complaints.append(str(found["entry"]))
