"""Chromium without a window, driven by the DevTools protocol over pipes: pages, input, pictures, and what went wrong.

Graphics are drawn in software (SwiftShader), so that pictures do not depend on the machine's hardware.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
ARGUMENTS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist", "--hide-scrollbars", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage", "--remote-debugging-pipe",
)  # fmt: skip
PATIENCE = 240.0
"""How long anything may take [s]."""
JOINTS = """(async () => {
  const { crowd, recording, scene } = crowdsimPlayer;
  await recording.load(Math.floor(FRAME / scene.block), true).promise;
  await recording.load(Math.floor(Math.min(FRAME + 1, scene.frames - 1) / scene.block), true).promise;
  return scene.names.map((_, avatar) => {
    crowd.pose(avatar, crowd.around(FRAME));
    return scene.figures[0].joints.map((_, j) => [...crowd.positions.subarray(3 * j, 3 * j + 3)]);
  });
})()"""
"""Positions of all joints of all avatars at a frame, by the page's own reading of its recording."""


class PageError(Exception):
    """A page did not do what was expected of it."""


def find() -> str | None:
    """Return the program, or None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """A browser with one page.

    Attributes:
        console: Errors and warnings on the console, and exceptions of the page.
        requests: Addresses that the page has asked for.
    """

    def __init__(self, size: tuple[int, int] = (1280, 720), dark: bool = False) -> None:
        program = find()
        if program is None:
            raise PageError("no Chromium was found")
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)

        def move() -> None:
            # The protocol wants descriptors 3 and 4.
            low, high = (fcntl.fcntl(pipe, fcntl.F_DUPFD, 64) for pipe in (theirs_in, theirs_out))
            os.dup2(low, 3)
            os.dup2(high, 4)

        command = [program, *ARGUMENTS, f"--window-size={size[0]},{size[1]}", f"--user-data-dir={self._profile.name}"]
        self._process = subprocess.Popen(
            [*command, "about:blank"], pass_fds=(3, 4), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True, preexec_fn=move,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._buffer, self._number, self._session = b"", 0, ""
        self.console: list[str] = []
        self.requests: list[str] = []
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target for target in targets if target["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the browser and remove its profile."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._in)
        os.close(self._out)
        self._profile.cleanup()

    def call(self, method: str, **keys: Any) -> Any:
        """Call a method of the protocol and return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": keys}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise PageError(f"{method}: {answer['error']}")
                return answer["result"]

    def _read(self) -> Any:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._buffer:
            if not select.select([self._in], [], [], max(0.0, end - time.monotonic()))[0]:
                raise PageError(f"the browser has not answered for {PATIENCE:g} s")
            more = os.read(self._in, 1 << 20)
            if not more:
                raise PageError("the browser has ended")
            self._buffer += more
        text, self._buffer = self._buffer.split(b"\0", 1)
        message = json.loads(text)
        method, keys = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.console.append(json.dumps(keys["exceptionDetails"])[:1000])
        elif method == "Runtime.consoleAPICalled" and keys["type"] in ("error", "warning", "assert"):
            self.console.append(json.dumps(keys["args"])[:1000])
        elif method == "Log.entryAdded" and keys["entry"]["level"] in ("error", "warning"):
            self.console.append(f"{keys['entry']['text']} {keys['entry'].get('url', '')}")
        elif method == "Network.requestWillBeSent":
            self.requests.append(keys["request"]["url"])
        return message

    def evaluate(self, expression: str) -> Any:
        """Return what an expression of the page gives, once it is settled."""
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise PageError(json.dumps(answer["exceptionDetails"])[:1000])
        return answer["result"].get("value")

    def wait(self, expression: str, seconds: float = PATIENCE) -> Any:
        """Wait until an expression is true, and return what it gives."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = self.evaluate(expression)
            if found:
                return found
            time.sleep(0.02)
        raise PageError(f"after {seconds:g} s this is not true: {expression}; console: {self.console}")

    def open(self, address: str | Path) -> None:
        """Load a page; a path is a page from a file."""
        url = address.absolute().as_uri() if isinstance(address, Path) else address
        self.console.clear()
        self.requests.clear()
        answer = self.call("Page.navigate", url=url)
        if answer.get("errorText"):
            raise PageError(f"{url}: {answer['errorText']}")

    def shown(self, address: str | Path) -> None:
        """Load a page of the player and wait until it shows a picture."""
        self.open(address)
        self.wait("['shown', 'failed'].includes(document.documentElement?.dataset.state)")
        if self.evaluate("document.documentElement.dataset.state") == "failed":
            raise PageError(self.evaluate("document.getElementById('message').textContent"))
        self.wait("typeof crowdsimPlayer === 'object'")

    def settle(self) -> None:
        """Wait until the picture of a player that is paused is drawn as finely as it will be."""
        self.wait("!crowdsimPlayer.playing && !crowdsimPlayer.dirty && !crowdsimPlayer.fine")

    def click(self, x: float, y: float) -> None:
        """Click at a point of the page."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 8) -> None:
        """Drag from a point to another."""
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], button="left", buttons=1)
        for step in range(1, steps + 1):
            x, y = (a + (b - a) * step / steps for a, b in zip(start, end, strict=True))
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left")

    def press(self, key: str) -> None:
        """Press a key."""
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def screenshot(self) -> bytes:
        """Return a picture of the page as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
