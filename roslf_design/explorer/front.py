"""The web server: page, assets, downloads, and a tab of its own for each connection. One process, one event loop."""

from __future__ import annotations

import asyncio
import errno
import signal
import socket
from collections.abc import Awaitable, Callable
from importlib.util import find_spec
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
from aiohttp import web

from ..errors import InputError, Problem
from .downloads import Download, DownloadError, download
from .session import Session
from .tab import Tab

HERE = Path(__file__).parent
FIRST_PORT, PORTS = 8517, 20
"""Where to listen unless told: the first of so many that is free."""

MAX_MESSAGE = 8 * 1024 * 1024

POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' {socket}; worker-src 'self' blob:; "
    "object-src 'none'; base-uri 'self'; frame-ancestors 'none'"
)
"""What the page may load: nothing from another host. Vue makes functions of its templates, hence unsafe-eval."""

TABS: web.AppKey[dict[str, Tab]] = web.AppKey("tabs", dict)


HOST: web.AppKey[str] = web.AppKey("host", str)


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
        return await _serve_tab(request, Tab(new_session()))

    app.router.add_get("/", _index)
    app.router.add_get("/index.html", _index)
    app.router.add_post("/client/paraview/", _launch)
    app.router.add_get("/ws", connect)
    app.router.add_get("/tab/{key}/{name:.+}", _download)
    app.router.add_static("/static", HERE / "static")
    app.router.add_static("/client", _client_folder())
    app.router.add_static("/vtk", _vtk_folder())
    app.on_shutdown.append(_close_tabs)
    return app


async def serve(
    app: web.Application, host: str, port: int | None, ready: Callable[[str], None], stop: asyncio.Event | None = None
) -> None:
    """Serve until `stop` is set or the process is asked to end (Ctrl-C, SIGTERM).

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
    stop : Event, optional
        Ends the server from within the process.

    Raises
    ------
    InputError
        The port is in use or none, or the host is not an address of this machine.
    """
    if port is not None and not 0 <= port <= 65535:
        raise InputError((Problem("--port", f"{port} is not a port; name one from 1024 to 65535, or 0 for any"),))
    stop = stop or asyncio.Event()
    loop = asyncio.get_running_loop()
    runner = web.AppRunner(app, handle_signals=False, access_log=None, shutdown_timeout=2.0)
    await runner.setup()
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    try:
        await _listen(runner, host, port)
        for number in signals:
            loop.add_signal_handler(number, stop.set)
        shown = "127.0.0.1" if host in ("0.0.0.0", "::") else host
        bracketed = f"[{shown}]" if ":" in shown else shown
        ready(f"http://{bracketed}:{runner.addresses[0][1]}/")
        await stop.wait()
    finally:
        for number in signals:
            loop.remove_signal_handler(number)
        await runner.cleanup()


async def _listen(runner: web.AppRunner, host: str, port: int | None) -> None:
    for choice in range(FIRST_PORT, FIRST_PORT + PORTS) if port is None else (port,):
        try:
            await web.TCPSite(runner, host, choice).start()
        except OSError as error:
            # asyncio words its own message around the system's, and drops the number of some.
            if error.errno == errno.EADDRINUSE:
                continue
            if error.errno == errno.EACCES:
                message = f"{choice} may not be listened on by this user; choose one above 1023"
                raise InputError((Problem("--port", message),)) from None
            message = (
                f"{host} is not an address of this machine ({error.strerror or error}); leave it out for 127.0.0.1"
            )
            raise InputError((Problem("--host", message),)) from None
        return
    if port is None:
        message = (
            f"{FIRST_PORT} to {FIRST_PORT + PORTS - 1} are all in use; name a free one, or 0 to let the system choose"
        )
    else:
        message = f"{port} is in use; name another, or leave it out to take the first free one"
    raise InputError((Problem("--port", message),))


async def _serve_tab(request: web.Request, tab: Tab) -> web.StreamResponse:
    _same_origin(request)
    connection = web.WebSocketResponse(max_msg_size=MAX_MESSAGE, heartbeat=20, compress=False)
    await connection.prepare(request)
    tabs = request.app[TABS]
    tabs[tab.key] = tab

    async def send(binary: bool, message: bytes | str) -> None:
        if not connection.closed:
            await (connection.send_bytes(message) if isinstance(message, bytes) else connection.send_str(message))

    tab.session.on_news = tab.push
    try:
        await tab.open(send)
        async for message in connection:
            await tab.answer(message.type == aiohttp.WSMsgType.BINARY, message)
    except ConnectionResetError:
        pass  # The browser went away while something was sent to it.
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
        made: Download | None = await download(tab.session, request.match_info["name"])
    except DownloadError as error:
        raise web.HTTPInternalServerError(text=str(error)) from None
    if made is None:
        raise web.HTTPNotFound(text="there is no such file")
    headers = {"Content-Disposition": f'attachment; filename="{made.name}"'}
    return web.Response(body=made.content, content_type=made.kind, headers=headers)


async def _launch(request: web.Request) -> web.StreamResponse:
    """Where to connect: what trame's client asks first of a launcher of processes, of which there is none here."""
    return web.json_response({"sessionURL": f"ws://{request.host}/ws", "secret": "wslink-secret"})


async def _index(request: web.Request) -> web.StreamResponse:
    text = (HERE / "layout" / "index.html").read_text(encoding="utf-8")
    script = next(_client_folder().glob("assets/index-*.js")).name
    style = next(_client_folder().glob("assets/index-*.css")).name
    return web.Response(
        text=text.replace("CLIENT_SCRIPT", script).replace("CLIENT_STYLE", style), content_type="text/html"
    )


@web.middleware
async def _guard(
    request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
) -> web.StreamResponse:
    _known_name(request)
    response = await handler(request)
    if not response.prepared:
        own = f"{'wss' if request.secure else 'ws'}://{request.host}"
        response.headers["Content-Security-Policy"] = POLICY.format(socket=own)
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers.setdefault("Cache-Control", "no-cache")
    return response


def _same_origin(request: web.Request) -> None:
    """Refuse a connection that a page of another site makes: it could read this machine's design files."""
    origin = request.headers.get("Origin")
    if origin is not None and urlsplit(origin).netloc != request.host:
        raise web.HTTPForbidden(text="only this explorer's own page may connect")


def _known_name(request: web.Request) -> None:
    """Refuse requests by a foreign name: a page elsewhere may have bound its own name to this machine's address."""
    name = urlsplit(f"//{request.host}").hostname or ""
    if name not in ("localhost", request.app[HOST], socket.gethostname()) and not _is_address(name):
        raise web.HTTPForbidden(text="open the explorer by this machine's address")


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def is_local(host: str) -> bool:
    """Whether an address is reached from this machine only."""
    return host == "localhost" or (_is_address(host) and ip_address(host).is_loopback)


def _client_folder() -> Path:
    from trame_client.module import vue3

    return Path(vue3.www)


def _vtk_folder() -> Path:
    # Found, not imported: the package would load all of VTK, which only the browser's half needs here.
    spec = find_spec("trame_vtk")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "modules" / "common" / "serve"
