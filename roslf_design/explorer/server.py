"""The web server: page, assets, downloads, and a tab of its own for each connection. One process, one event loop.

A trame server shares its state with every client that connects to it; so each connection here gets a server of its
own, which ends with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import re
import secrets
import signal
import socket
from collections.abc import Awaitable, Callable
from importlib.util import find_spec
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path
from typing import Any

import aiohttp
from aiohttp import hdrs, web
from aiohttp.http_exceptions import HttpProcessingError
from aiohttp.log import server_logger
from trame_client.module import vue3
from trame_server import Server

from ..errors import FAULTS, refusal
from .jobs import ASIDE
from .session import DownloadError, Session
from .view import with_cards

PAGE = Path(__file__).parent / "page"
"""Templates, script and style of the page."""
CLIENT = Path(vue3.www)
"""Trame's half in the browser."""

FIRST_PORT, PORTS = 8517, 20
"""Where to listen unless told: the first of so many that is free."""

MAX_MESSAGE = 8 * 1024 * 1024

POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' {socket}; worker-src 'self' blob:; "
    "object-src 'none'; base-uri 'self'; frame-ancestors 'none'"
)
"""Content security policy of the page: nothing from another host. Vue makes functions of its templates, hence
unsafe-eval."""

AUTHORITY = re.compile(r"(?:([a-z0-9._-]+)|\[([0-9a-f:.]+)\])(?::([0-9]{1,5}))?", re.IGNORECASE | re.ASCII)
"""A host as browsers name it: a name or an address, IPv6 in brackets, with or without a port."""

ENDINGS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""Signals that ask the process to end; no system has all of them."""

MISSING = "there is no such file"

HOST: web.AppKey[str] = web.AppKey("host", str)


class _Tab:
    """A connection to the page; `answer` takes its messages, `close` ends all that it started."""

    def __init__(self, session: Session) -> None:
        self.key = secrets.token_urlsafe(16)
        """Names the tab in addresses of downloads."""
        self.session = session
        session.on_news = self.push
        self._server = Server(f"explorer-{self.key}")
        self._server.client_type = "vue3"
        self._asked = self._news = 0
        self._fresh: list[str] = []
        """Values of the page that are of what was asked last."""
        self._showing: asyncio.Task[None] | None = None
        self._backend: Any = None
        self._connection: Any = None
        self._running: asyncio.Task[None] | None = None

    async def open(self, send: Callable[[bool, bytes | str], Awaitable[None]]) -> None:
        """Start the tab's server; `send` brings its messages to the browser."""
        server = self._server
        server.enable_module({"vue_use": ["roslfExplorer"]})
        state = server.state
        state.trame__title = "roslf explore"
        state.trame__template_main = with_cards((PAGE / "page.html").read_text(encoding="utf-8"))
        state.trame__template_error = (PAGE / "gone.html").read_text(encoding="utf-8")
        state.update({**self.session.page(), "tab_key": self.key, "answered": 0, "fresh": []})
        for name in self.session.requests:
            server.controller.trigger(name)(self._handler(name))
        server.controller.on_server_bind.add(self._bound)
        options = {"open_browser": False, "show_connection_info": False, "disable_logging": True, "timeout": 0}
        starting = server.start(exec_mode="coroutine", backend="generic", **options)
        self._running = asyncio.get_running_loop().create_task(starting)
        await server.ready
        self._connection = await self._backend["ws"].connect()
        self._connection.on_message(send)

    async def answer(self, message: Any) -> None:
        """Take one message of the browser."""
        await self._connection.send(True, message)

    def push(self) -> None:
        """Show what has changed, also without being asked, such as the progress of a run."""
        self._news += 1
        if self._showing is None or self._showing.done():
            self._showing = asyncio.get_running_loop().create_task(self._show())

    async def _show(self) -> None:
        """Bring the page up to date part by part, begun anew where something is asked meanwhile."""
        shown = -1
        while shown != self._news:
            shown, asked = self._news, self._asked
            try:
                for part in self.session.parts():
                    values = await asyncio.get_running_loop().run_in_executor(ASIDE, part)
                    # In one order: another one would be sent as news, at each tick of a run.
                    self._fresh = sorted({*self._fresh, *values}) if self._asked == asked else []
                    self._update({**values, "fresh": self._fresh})
                    if self._asked != asked:
                        break
                else:
                    self._update({"answered": asked})
            except (*FAULTS, OSError):  # the terminal says why; the page waits no longer
                self._update({"answered": asked})
                server_logger.exception("A part of the page failed")

    def _update(self, values: dict[str, Any]) -> None:
        with self._server.state as state:
            state.update(values)

    async def close(self) -> None:
        """End the server and everything that runs for it; may be called twice."""
        self.session.close()
        if self._showing is not None:
            self._showing.cancel()
        if self._connection is not None:
            connection, self._connection = self._connection, None
            await connection.close()
        if self._running is not None:
            running, self._running = self._running, None
            await self._server.stop()
            running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await running

    def _bound(self, backend: Any) -> None:
        self._backend = backend

    def _handler(self, name: str) -> Callable[..., int]:
        def handle(*arguments: Any) -> int:
            self.session.ask(name, *arguments)
            self._asked += 1
            if name not in self.session.of_the_page:
                self._fresh = []
            self._update({"fresh": self._fresh})
            self.push()
            return self._asked

        return handle


TABS: web.AppKey[dict[str, _Tab]] = web.AppKey("tabs", dict)


def application(new_session: Callable[[], Session], host: str = "127.0.0.1") -> web.Application:
    """The app that serves the page; each connection to it works on a session of its own.

    Parameters
    ----------
    new_session : callable
        Gives a fresh one.
    host : str
        Where it will listen; requests by another name than this machine's are refused.
    """
    app = web.Application(middlewares=[_guard])
    app[TABS], app[HOST] = {}, host

    async def connect(request: web.Request) -> web.StreamResponse:
        return await _serve_tab(request, _Tab(new_session()))

    # Its place is looked for, not imported: the package would load all of VTK, which only the browser needs.
    vtk = find_spec("trame_vtk")
    assert vtk is not None
    assert vtk.origin is not None
    app.router.add_get("/", _index)
    app.router.add_get("/index.html", _index)
    app.router.add_post("/client/paraview/", _launch)
    app.router.add_get("/ws", connect)
    app.router.add_get("/tab/{key}/{name:.+}", _download)
    app.router.add_static("/page", PAGE)
    app.router.add_static("/client", CLIENT)
    app.router.add_static("/vtk", Path(vtk.origin).parent / "modules" / "common" / "serve")
    app.on_shutdown.append(_close_tabs)
    return app


async def serve(app: web.Application, host: str, port: int | None, ready: Callable[[str], None]) -> None:
    """Serve until the process is asked to end (Ctrl-C, SIGTERM).

    Parameters
    ----------
    app : Application
        From `application`.
    host : str
        Address to listen on.
    port : int, optional
        0 lets the system choose; None takes the first free one from `FIRST_PORT` on.
    ready : callable
        Called with the page's address once it can be opened.

    Raises
    ------
    InputError
        The port is in use or none, or the host is not an address of this machine.
    """
    server_logger.addFilter(_is_ours)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    runner = web.AppRunner(app, handle_signals=False, access_log=None, shutdown_timeout=2.0)
    await runner.setup()
    before = {}
    try:
        await _listen(runner, host, port)
        # Not the loop's own handlers, which Windows has not.
        for number in (getattr(signal, name) for name in ENDINGS if hasattr(signal, name)):
            before[number] = signal.signal(number, lambda *_: loop.call_soon_threadsafe(stop.set))
        shown = "127.0.0.1" if host in ("0.0.0.0", "::") else host
        bracketed = f"[{shown}]" if ":" in shown else shown
        ready(f"http://{bracketed}:{runner.addresses[0][1]}/")
        await stop.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        await runner.cleanup()


def _is_ours(record: logging.LogRecord) -> bool:
    """Whether what the server logs is no mere request that was none of HTTP's; such is answered, with no traceback."""
    return record.exc_info is None or not isinstance(record.exc_info[1], HttpProcessingError)


async def _listen(runner: web.AppRunner, host: str, port: int | None) -> None:
    if port is not None and not 0 <= port <= 65535:
        raise refusal("port", f"{port} is not a port; name one from 1024 to 65535, or 0 for any")
    for choice in range(FIRST_PORT, FIRST_PORT + PORTS) if port is None else (port,):
        try:
            return await web.TCPSite(runner, host, choice).start()
        except UnicodeError:  # a label of more than 63 letters
            raise refusal("host", f"{host} is no name of a machine; leave it out for 127.0.0.1") from None
        except OSError as error:
            # asyncio words its own message around the system's, and drops the number of some.
            if error.errno == errno.EACCES:
                message = f"{choice} may not be listened on by this user; choose one above 1023"
                raise refusal("port", message) from None
            if error.errno != errno.EADDRINUSE:
                why = error.strerror or error
                message = f"{host} is not an address of this machine ({why}); leave it out for 127.0.0.1"
                raise refusal("host", message) from None
    last = FIRST_PORT + PORTS - 1
    many = f"{FIRST_PORT} to {last} are all in use; name a free one, or 0 to let the system choose"
    one = f"{port} is in use; name another, or leave it out to take the first free one"
    raise refusal("port", many if port is None else one)


async def _serve_tab(request: web.Request, tab: _Tab) -> web.StreamResponse:
    # A page of another site that connects could read this machine's design files.
    own = tuple(f"{scheme}://{request.host}".lower() for scheme in ("http", "https"))
    if any(origin.lower() not in own for origin in request.headers.getall(hdrs.ORIGIN, ())):
        raise web.HTTPForbidden(text="only this explorer's own page may connect")
    connection = web.WebSocketResponse(max_msg_size=MAX_MESSAGE, heartbeat=20, compress=False)
    try:
        await connection.prepare(request)
    except ConnectionResetError:  # it is gone already
        return web.Response()
    tabs = request.app[TABS]
    tabs[tab.key] = tab

    async def send(binary: bool, message: bytes | str) -> None:
        # The browser may go away at any time, also while something is sent to it; the loop below then ends.
        with contextlib.suppress(ConnectionResetError):
            if not connection.closed:
                await (connection.send_bytes(message) if isinstance(message, bytes) else connection.send_str(message))

    try:
        await tab.open(send)
        async for message in connection:
            try:
                if message.type != aiohttp.WSMsgType.BINARY:
                    raise TypeError
                await tab.answer(message)
            except (ValueError, TypeError, KeyError, AttributeError):
                # Requests are answered with what is wrong with them; this was none, and what follows may be its rest.
                await connection.close(code=aiohttp.WSCloseCode.UNSUPPORTED_DATA, message=b"no message of this page")
    finally:
        tabs.pop(tab.key, None)
        await tab.close()
    return connection


async def _close_tabs(app: web.Application) -> None:
    for tab in list(app[TABS].values()):
        await tab.close()
    # Their sockets' handlers end as the runner cancels them.


async def _download(request: web.Request) -> web.StreamResponse:
    tab = request.app[TABS].get(request.match_info["key"])
    if tab is None:
        raise web.HTTPNotFound(text="this tab is closed; open the page again")
    try:
        file = await tab.session.download(request.match_info["name"])
    except DownloadError as error:
        raise web.HTTPInternalServerError(text=str(error)) from None
    if file is None:
        raise web.HTTPNotFound(text=MISSING)
    headers = {"Content-Disposition": f'attachment; filename="{file.name}"'}
    return web.Response(body=file.content, content_type=file.kind, headers=headers)


async def _launch(request: web.Request) -> web.StreamResponse:
    """Where to connect: what trame's client asks first of a launcher of processes, of which there is none here."""
    return web.json_response({"sessionURL": f"ws://{request.host}/ws", "secret": "wslink-secret"})


async def _index(request: web.Request) -> web.StreamResponse:
    text = (PAGE / "index.html").read_text(encoding="utf-8")
    for name, pattern in (("CLIENT_SCRIPT", "assets/index-*.js"), ("CLIENT_STYLE", "assets/index-*.css")):
        text = text.replace(name, next(CLIENT.glob(pattern)).name)
    return web.Response(text=text, content_type="text/html")


@web.middleware
async def _guard(
    request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
) -> web.StreamResponse:
    """Refuse requests by a foreign name (a page elsewhere may have bound it to this machine); set the policy."""
    hosts = request.headers.getall(hdrs.HOST, ())
    if len(hosts) != 1 or not _is_own(hosts[0], request.app[HOST]):
        raise web.HTTPForbidden(text="open the explorer by this machine's address")
    try:
        response = await handler(request)
    except OSError:  # of a name that the system refuses, such as one of 300 letters
        raise web.HTTPNotFound(text=MISSING) from None
    if not response.prepared:
        socket_address = f"{'wss' if request.secure else 'ws'}://{request.host}"
        response.headers["Content-Security-Policy"] = POLICY.format(socket=socket_address)
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers.setdefault("Cache-Control", "no-cache")
    return response


def _is_own(authority: str, host: str) -> bool:
    """Whether a request's Host names this machine: by a name of its own, or an address, which nobody else can bind."""
    match = AUTHORITY.fullmatch(authority)
    if match is None or int(match[3] or 1) not in range(1, 65536):
        return False
    name, bracketed = (match[1] or "").lower(), match[2]
    if bracketed is not None:
        return isinstance(_address(bracketed), IPv6Address)
    return name in ("localhost", host.lower(), socket.gethostname().lower()) or _address(name) is not None


def _address(name: str) -> IPv4Address | IPv6Address | None:
    with contextlib.suppress(ValueError):
        return ip_address(name)
    return None


def is_local(host: str) -> bool:
    """Whether an address is reached from this machine only."""
    address = _address(host)
    return host.lower() == "localhost" or (address is not None and address.is_loopback)
