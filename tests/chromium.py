"""Chromium, driven by its DevTools protocol over a pair of pipes: pages, keys, pictures, errors."""

import base64
import itertools
import json
import os
import select
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# Long enough while other tests want all processors.
WAIT_S = 300.0
# The pipes of --remote-debugging-pipe are the descriptors 3 and 4.
_START = 'exec chromium "$@" 3<&{commands} 4>&{answers}'
_OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars",
    "--remote-debugging-pipe", "--no-first-run", "--disable-background-networking",
)  # fmt: skip
# What it answers about a page from which it navigates just then.
_LEFT = ("Inspected target navigated or closed", "Execution context was destroyed.",
         "Cannot find context with specified id")  # fmt: skip
# A page of many links and fields.
_MOST_TABS = 200
KEYS = {
    "F8": 119, "F9": 120, "Tab": 9, "Enter": 13, "Space": 32,
    "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40,
}  # fmt: skip


class PageLeftError(Exception):
    """A page was left for another one before it answered."""


class Chromium:
    """A running browser."""

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers = commands, answers
        self._ids = itertools.count(1)
        self._rest = b""
        self._context: dict[str, str] = {}
        self.events: list[dict[str, Any]] = []

    def call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = next(self._ids)
        message = {"id": number, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == number:
                if answer.get("error", {}).get("message") in _LEFT:
                    raise PageLeftError(answer)
                assert "error" not in answer, answer
                return dict(answer["result"])
            self.events.append(answer)

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            assert select.select([self._answers], [], [], WAIT_S)[0], "Chromium does not answer"
            block = os.read(self._answers, 1 << 16)
            assert block, "Chromium has ended"
            self._rest += block
        text, _, self._rest = self._rest.partition(b"\0")
        return dict(json.loads(text))

    @contextmanager
    def anew(self) -> Iterator["Chromium"]:
        """Open pages as in a new browser, which would take a second to start."""
        self._context = self.call("Target.createBrowserContext")
        yield self
        self.call("Target.disposeBrowserContext", **self._context)
        self.events.clear()

    def page(
        self, url: str, width: int = 1280, height: int = 800, *, dark: bool = False,
        alone: bool = False,
    ) -> "Page":  # fmt: skip
        """Open a page, and wait until it is loaded; `alone` is as in a browser of its own."""
        context = self.call("Target.createBrowserContext") if alone else self._context
        target = self.call("Target.createTarget", url="about:blank", **context)["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        page = Page(self, attached["sessionId"])
        for domain in ("Page", "Runtime", "Log"):
            page.call(f"{domain}.enable")
        page.show(width, height, dark=dark)
        page.go(url)
        return page


class Page:
    """A page in a browser."""

    def __init__(self, browser: Chromium, session: str) -> None:
        self._browser, self._session = browser, session

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol for this page."""
        return self._browser.call(method, self._session, **parameters)

    def show(self, width: int, height: int, *, dark: bool = False) -> None:
        """Show the page on a screen of a size, in a dark or a light room."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def go(self, url: str) -> None:
        """Go to an address, and wait until the page is loaded."""
        self.call("Page.navigate", url=url)
        self.until("document.readyState == 'complete' && location.href != 'about:blank'")

    def value(self, script: str) -> Any:
        """The value of an expression of JavaScript; a promise is awaited."""
        found = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def text(self, id_: str) -> str:
        """The text of the element with an id."""
        return str(self.value(f"document.getElementById({id_!r}).textContent"))

    def is_true(self, script: str) -> bool:
        """Whether an expression of JavaScript is true, which it is not between two pages."""
        try:
            return bool(self.value(script))
        except PageLeftError:
            return False

    def until(self, script: str, wait_s: float = WAIT_S, pause_s: float = 0.02) -> None:
        """Wait until an expression of JavaScript is true; ask again after each pause."""
        given_up_s = time.monotonic() + wait_s
        while not self.is_true(script):
            assert time.monotonic() < given_up_s, f"never true: {script}"
            time.sleep(pause_s)

    def until_at(self, path: str) -> None:
        """Wait until a link or a form has led to a page, and the page is loaded.

        Its address changes before it has any element.
        """
        self.until(f"document.readyState == 'complete' && location.pathname == {json.dumps(path)}")

    def press(self, key: str) -> None:
        """Press a key."""
        about = {"key": key, "code": key, "windowsVirtualKeyCode": KEYS[key]}
        if key == "Enter":
            about["text"] = "\r"
        elif key == "Space":
            about |= {"key": " ", "text": " "}
        self.call("Input.dispatchKeyEvent", type="keyDown", **about)
        self.call("Input.dispatchKeyEvent", type="keyUp", **about)

    def tab_to(self, selector: str) -> None:
        """Press Tab until the element that a selector of CSS names has the focus."""
        for _ in range(_MOST_TABS):
            self.press("Tab")
            if self.value(f"document.activeElement?.matches({json.dumps(selector)})"):
                return
        raise AssertionError(f"Tab does not reach {selector}")

    def type(self, text: str) -> None:
        """Type a text into the field that has the focus, or gets it by `autofocus`."""
        self.until("!!document.activeElement?.matches('input, textarea, select')")
        self.call("Input.insertText", text=text)

    def picture(self, path: Path, *, scale: float = 1.0) -> None:
        """Keep a picture of the page, as JPEG or PNG by the name of the file."""
        kept = {"format": "jpeg", "quality": 60} if path.suffix == ".jpg" else {"format": "png"}
        size = self.value("({width: innerWidth, height: innerHeight})")
        clip = {"x": 0, "y": 0, "scale": scale, **size}
        shot = self.call("Page.captureScreenshot", clip=clip, **kept)
        path.write_bytes(base64.b64decode(shot["data"]))

    def errors(self) -> list[str]:
        """What the console has shown as errors."""
        self.value("1")  # what was shown before has arrived
        found = []
        for event in self._browser.events:
            if event.get("sessionId") != self._session:
                continue
            about = event["params"]
            is_logged = event["method"] == "Log.entryAdded" and about["entry"]["level"] == "error"
            is_said = event["method"] == "Runtime.consoleAPICalled" and about["type"] == "error"
            if is_logged or is_said or event["method"] == "Runtime.exceptionThrown":
                found.append(json.dumps(about))
        return found


@contextmanager
def chromium(profile: Path) -> Iterator[Chromium]:
    """Run a browser with an empty profile."""
    (its_commands, commands), (answers, its_answers) = os.pipe(), os.pipe()
    start = _START.format(commands=its_commands, answers=its_answers)
    process = subprocess.Popen(
        ("bash", "-c", start, "chromium", *_OPTIONS, f"--user-data-dir={profile}"),
        pass_fds=(its_commands, its_answers),
        stderr=subprocess.DEVNULL,
    )
    os.close(its_commands)
    os.close(its_answers)
    browser = Chromium(commands, answers)
    try:
        yield browser
        browser.call("Browser.close")
    finally:
        os.close(commands)
        os.close(answers)
        try:
            process.wait(WAIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
