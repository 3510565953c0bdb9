"""Opens every page of the built site in Chromium, as wide as a phone and as a desk, and
says what is wrong with it: `make docs-check`.

Chromium is spoken to through a pair of pipes, by its DevTools protocol, for which the
standard library is enough.
"""

import base64
import fcntl
import functools
import itertools
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[1]
SITE, PICTURES = ROOT / "site", ROOT / "build" / "screenshots"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SIZES = {"phone": (390, 844), "desk": (1280, 900)}  # px
MISSING = (
    "make docs-check opens the pages in Chromium, which is not here. On Debian and "
    "Ubuntu: apt install chromium; elsewhere any Chromium or Chrome on the PATH does."
)
# The widest thing that sticks out of the page, if something does.
OVERFLOW = """(() => {
  const page = document.documentElement, wide = page.clientWidth;
  if (page.scrollWidth <= wide) return "";
  const out = [...document.querySelectorAll("main *")].filter(
    (each) => each.getBoundingClientRect().right > wide + 1);
  const what = out.at(-1);
  return `${page.scrollWidth} px wide on a screen of ${wide} px` +
    (what ? ` (${what.tagName.toLowerCase()}: ${what.textContent.slice(0, 60)})` : "");
})()"""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format, *args):
        pass


class Browser:
    """A Chromium without a window, and one tab in it."""

    def __init__(self, program: str, profile: str):
        # Chromium reads from file 3 and writes to file 4: out of their way with ours.
        (theirs_in, ours_out), (ours_in, theirs_out) = (
            [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in os.pipe()]
            for _ in range(2)
        )

        def numbered():
            os.dup2(theirs_in, 3)
            os.dup2(theirs_out, 4)

        command = [program, "--headless", "--remote-debugging-pipe", "--no-sandbox"]
        command += ["--disable-gpu", "--hide-scrollbars", f"--user-data-dir={profile}"]
        self.process = subprocess.Popen(
            command,
            preexec_fn=numbered,
            pass_fds=(3, 4),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self.write, self.read = os.fdopen(ours_out, "wb"), os.fdopen(ours_in, "rb")
        self.numbers, self.buffer = itertools.count(1), b""
        self.session: dict[str, str] = {}
        self.events: list[dict[str, Any]] = []
        target = self("Target.createTarget", url="about:blank")["targetId"]
        tab = self("Target.attachToTarget", targetId=target, flatten=True)
        self.session = {"sessionId": tab["sessionId"]}
        for part in ("Page", "Runtime", "Log", "Network"):
            self(f"{part}.enable")

    def __call__(self, method: str, **params: Any) -> dict[str, Any]:
        """The answer to a request; events that come before it are kept."""
        number = next(self.numbers)
        asked = {"id": number, "method": method, "params": params, **self.session}
        self.write.write(json.dumps(asked).encode() + b"\0")
        self.write.flush()
        while True:
            message = self._next()
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]
            self.events.append(message)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self.buffer:
            part = os.read(self.read.fileno(), 1 << 20)
            if not part:
                raise RuntimeError("Chromium ended before its time.")
            self.buffer += part
        message, _, self.buffer = self.buffer.partition(b"\0")
        return json.loads(message)

    def open(self, address: str, size: tuple[int, int]) -> None:
        """Load a page on a screen of that size."""
        width, height = size
        screen = {"width": width, "height": height, "deviceScaleFactor": 1}
        self("Emulation.setDeviceMetricsOverride", mobile=width < 600, **screen)
        self.events.clear()
        self("Page.navigate", url=address)
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self._next())

    def complaints(self) -> Iterator[str]:
        """What the console has against the page that was opened last."""
        for event in self.events:
            said = event.get("params", {})
            entry, kind = said.get("entry", {}), said.get("type")
            if event.get("method") == "Runtime.exceptionThrown":
                yield said["exceptionDetails"]["text"]
            elif entry.get("level") == "error":
                yield f"{entry['text']} ({entry.get('url', '')})"
            elif kind in ("error", "assert") and "args" in said:
                yield " ".join(str(each.get("value")) for each in said["args"])

    def overflow(self) -> str:
        """What is wider than the screen."""
        return self("Runtime.evaluate", expression=OVERFLOW)["result"]["value"]

    def picture(self, path: Path) -> None:
        """Save what is to be seen before scrolling."""
        shot = self("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(shot["data"]))

    def close(self) -> None:
        """End it."""
        self.write.close()
        self.process.terminate()
        self.process.wait()


def faults(browser: Browser, address: str) -> Iterator[str]:
    """What is wrong with each page, and pictures of all."""
    for path in sorted(SITE.rglob("*.html")):
        place = path.relative_to(SITE)
        if place.name != "index.html":
            continue
        page = place.parent.as_posix()
        for name, size in SIZES.items():
            browser.open(f"{address}/{'' if page == '.' else page + '/'}", size)
            wide = browser.overflow()
            stem = "home" if page == "." else page.replace("/", "_")
            browser.picture(PICTURES / f"{stem}_{name}.png")
            yield from (f"{page}: {each}" for each in browser.complaints())
            if wide:
                yield f"{page}: {wide}"


def main() -> int:
    """Check the site, and return how it went."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        print(MISSING, file=sys.stderr)
        return 1
    PICTURES.mkdir(parents=True, exist_ok=True)
    handler = functools.partial(_Quiet, directory=str(SITE))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(program, profile)
        try:
            found = [*faults(browser, f"http://127.0.0.1:{server.server_port}")]
        finally:
            browser.close()
    for each in dict.fromkeys(found):
        print(each, file=sys.stderr)
    pages = len([*PICTURES.glob("*_phone.png")])
    print(f"{pages} pages, {len(found)} faults; screenshots are in {PICTURES}")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
