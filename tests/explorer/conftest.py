"""One running explorer and one browser for all tests that need them."""

import os
import re
import shutil
import signal
import subprocess
import sys

import pytest

from roslf_design.design import load
from roslf_design.explorer.state import Look, State, encode

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--enable-unsafe-swiftshader"),
)

OFTEN = 30
"""Between two looks at whether a page is ready [ms]: looking at every frame has the browser draw sixty a second."""
LINK = encode(State.of(load("paper")), Look())


class Explorer:
    """`roslf explore` in a process of its own."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "roslf_design", "explore", *arguments, "--no-browser"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        line = self.process.stdout.readline()
        match = re.search(r"http://\S+", line)
        assert match, line + (self.process.stderr.read() if self.process.wait(10) is not None else "")
        self.address = match[0]

    def processes(self) -> list[str]:
        """Command lines of everything that it has started and that still runs, itself included."""
        listed = subprocess.run(["ps", "-o", "args=", "-g", str(self.process.pid)], capture_output=True, text=True)
        return listed.stdout.splitlines()

    def runs(self) -> list[str]:
        """Runs that go on: Python's own helper, which tracks shared resources, is none."""
        return [line for line in self.processes() if "multiprocessing" in line and "resource_tracker" not in line]

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
        # With scroll bars, as a user has them: they take room from what they scroll.
        shown = ["--hide-scrollbars"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS), ignore_default_args=shown)
        yield browser
        browser.close()


class Window:
    """A window of the browser, what its page complains of, and the hosts that it asks."""

    def __init__(self, chromium, theme: str = "light") -> None:
        self.complaints: list[str] = []
        self.hosts: set[str] = set()
        # Nothing moves by itself: what does is drawn sixty times a second for as long as it is waited for.
        self.context = chromium.new_context(color_scheme=theme, accept_downloads=True, reduced_motion="reduce")
        # Finds what hangs, not what is slow: two cores that compile all kernels take 20 s to the first answer.
        self.context.set_default_timeout(120_000)
        self.page = self.context.new_page()
        self.page.on("console", lambda m: m.type in ("error", "warning") and self._complained(m.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self._asked(request.url))
        self.page.on("websocket", lambda socket: self._asked(socket.url))

    def open(self, address: str, width: int = 1366, height: int = 768):
        """Go to an address: a fresh session of the explorer."""
        self.own = re.match(r"http://([^/]+)", address)[1]
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.goto("about:blank")  # A link that differs in its fragment alone would not load the page anew.
        self.page.goto(address)
        self.page.wait_for_selector(".picture svg:visible")
        return self.page

    def bring_back(self, address: str):
        """The page that is open, as a link to the paper has it; what was done before can still be undone."""
        if not self.page.url.startswith(address):
            return self.open(address)
        self.page.set_viewport_size({"width": 1366, "height": 768})
        self.page.evaluate("link => new Promise(done => { location.hash = link; setTimeout(done, 50); })", LINK)
        self.page.wait_for_function("!document.documentElement.dataset.busy", polling=OFTEN)
        return self.page

    def check(self) -> None:
        """Fail where the page complained, or asked anyone but its explorer."""
        assert self.complaints == []
        assert self.hosts == {self.own}

    def _complained(self, text: str) -> None:
        # Chromium says so of drawing without a graphics card; it is no fault of the page.
        if "GPU stall due to ReadPixels" not in text:
            self.complaints.append(text)

    def _asked(self, url: str) -> None:
        if host := re.match(r"(?:http|ws)s?://([^/]+)", url):
            self.hosts.add(host[1])


@pytest.fixture(scope="module")
def window(chromium):
    """The window that tests share: pages open in it in half the time."""
    shared = Window(chromium)
    yield shared
    shared.context.close()


@pytest.fixture
def page(window, explorer):
    """A page of the explorer at the size of a small laptop's screen."""
    yield window.open(explorer.address)
    window.check()


@pytest.fixture
def same_page(window, explorer):
    """The page of the test before, brought back to the paper: to open one is most of what a short test takes."""
    yield window.bring_back(explorer.address)
    window.check()


@pytest.fixture
def open_page(chromium, explorer):
    """Open the explorer in a window of its own."""
    windows = []

    def opened(address: str = "", width: int = 1366, height: int = 768, theme: str = "light"):
        windows.append(Window(chromium, theme))
        return windows[-1].open(address or explorer.address, width, height)

    yield opened
    for each in windows:
        each.context.close()
        each.check()
