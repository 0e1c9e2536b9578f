"""A running explorer, and a browser that looks at it."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--enable-unsafe-swiftshader"),
)


class Explorer:
    """`roslf explore` in a process of its own."""

    def __init__(self, *arguments: str) -> None:
        command = [str(Path(sys.executable).with_name("roslf")), "explore", *arguments, "--no-browser"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        self.said = self.process.stdout.readline()
        found = re.search(r"http://\S+", self.said)
        assert found, self.said + (self.process.stderr.read() if self.process.wait(10) is not None else "")
        self.address = found[0]

    def processes(self) -> list[str]:
        """Command lines of everything that it has started and that still runs, itself included."""
        found = subprocess.run(["ps", "-o", "args=", "-g", str(self.process.pid)], capture_output=True, text=True)
        return found.stdout.splitlines()

    def end(self, number: int = signal.SIGTERM) -> int:
        """Ask it to end as a user does; its exit code."""
        if self.process.poll() is None:
            os.kill(self.process.pid, number)
        code = self.process.wait(10)
        self.process.stdout.close()
        self.stderr = self.process.stderr.read()
        self.process.stderr.close()
        return code


@pytest.fixture(scope="session")
def explorer():
    """One explorer for all tests: each page in it has a state of its own."""
    running = Explorer("--port", "0")
    yield running
    assert running.end() == 0
    assert running.stderr == ""


@pytest.fixture(scope="module")
def chromium():
    """Debian's browser, driven by Playwright; only while a module needs it, as an event loop runs meanwhile."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield browser
        browser.close()


class Watch:
    """What a page complains of, and the hosts that it asks."""

    def __init__(self, page) -> None:
        self.complaints: list[str] = []
        self.hosts: set[str] = set()
        page.on("console", lambda m: m.type in ("error", "warning") and self._told(m.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self._asked(request.url))
        page.on("websocket", lambda socket: self._asked(socket.url))

    def _told(self, text: str) -> None:
        # Chromium says so of drawing without a graphics card; it is no fault of the page.
        if "GPU stall due to ReadPixels" not in text:
            self.complaints.append(text)

    def _asked(self, url: str) -> None:
        host = re.match(r"(?:http|ws)s?://([^/]+)", url)
        if host:
            self.hosts.add(host[1])


@pytest.fixture
def open_page(chromium, explorer):
    """Open the explorer in a window of its own; what the page complained of fails the test."""
    windows = []

    def opened(address: str = "", width: int = 1366, height: int = 768, theme: str = "light"):
        context = chromium.new_context(
            viewport={"width": width, "height": height}, color_scheme=theme, accept_downloads=True
        )
        context.set_default_timeout(8000)
        page = context.new_page()
        address = address or explorer.address
        windows.append((context, Watch(page), re.match(r"http://([^/]+)", address)[1]))
        page.goto(address)
        page.wait_for_selector(".picture svg:visible")
        return page

    yield opened
    for context, watch, own in windows:
        context.close()
        assert watch.complaints == []
        assert watch.hosts == {own}


@pytest.fixture
def page(open_page):
    """A page of the explorer at the size of a small laptop's screen."""
    return open_page()
