"""A headless Chromium for tests, driven over its pipe with the standard library alone."""

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Browser:
    """One tab.  ``errors`` holds every exception and every error on its console."""

    def __init__(self, folder: Path, width: int = 1280, height: int = 900) -> None:
        if CHROMIUM is None:
            pytest.skip("no Chromium is installed to look at pages with")
        (to_read, self._to), (self._from, to_write) = os.pipe(), os.pipe()

        def wire() -> None:  # Chromium reads its commands from 3 and answers on 4
            read, write = (fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_read, to_write))
            os.dup2(read, 3)
            os.dup2(write, 4)

        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--remote-debugging-pipe", "--no-first-run"]
        command = [CHROMIUM, *flags, f"--user-data-dir={folder / 'chromium'}", "about:blank"]
        self.process = subprocess.Popen(
            command, preexec_fn=wire, pass_fds=(3, 4), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        os.close(to_read)
        os.close(to_write)
        self._buffer, self._id, self._session = b"", 0, None
        self.errors: list[str] = []
        targets = self.ask("Target.getTargets")["targetInfos"]
        tab = next(one["targetId"] for one in targets if one["type"] == "page")
        self._session = self.ask("Target.attachToTarget", targetId=tab, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")
        self.resize(width, height)

    def ask(self, method: str, timeout_s: float = 40.0, **params) -> dict:
        """Send a command and return its result."""
        self._id += 1
        message = {"id": self._id, "method": method, "params": params} | ({"sessionId": self._session} if self._session else {})
        os.write(self._to, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            answer = self._message(deadline - time.monotonic())
            if answer is not None and answer.get("id") == self._id:
                assert "error" not in answer, answer
                return answer["result"]
        raise AssertionError(f"the browser did not answer {method} within {timeout_s:g} s")

    def _message(self, timeout_s: float) -> dict | None:
        while b"\0" not in self._buffer:
            if not select.select([self._from], [], [], max(timeout_s, 0.0))[0]:
                return None
            self._buffer += os.read(self._from, 1 << 20)
        raw, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(raw)
        if message.get("method") == "Runtime.exceptionThrown":
            details = message["params"]["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif message.get("method") == "Log.entryAdded" and message["params"]["entry"]["level"] == "error":
            self.errors.append(message["params"]["entry"]["text"])
        return message

    def open(self, address: str) -> None:
        """Go to an address and wait until it is there."""
        self.ask("Page.navigate", url=address)
        self.wait_for("location.href != 'about:blank' && document.readyState == 'complete'")

    def value(self, expression: str):
        """What an expression is, promises waited for."""
        result = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait_for(self, expression: str, timeout_s: float = 30.0):
        """Wait until an expression is true, and return it."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if found := self.value(expression):
                return found
            time.sleep(0.1)
        raise AssertionError(f"never true: {expression}; errors: {self.errors}; page: {self.value('document.body.innerText')[:600]}")

    def resize(self, width: int, height: int, dark: bool = False) -> None:
        """Width and height in pixels, light or dark."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500)
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.ask("Emulation.setEmulatedMedia", features=scheme)

    def screenshot(self, path: Path) -> None:
        """Write what is seen, all of the page, as PNG."""
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", captureBeyondViewport=True)["data"]))

    def close(self) -> None:
        """End the browser."""
        with contextlib.suppress(Exception):
            self.ask("Browser.close", timeout_s=5.0)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(5.0)
        if self.process.poll() is None:
            os.killpg(self.process.pid, 9)
            self.process.wait()
        os.close(self._to)
        os.close(self._from)
