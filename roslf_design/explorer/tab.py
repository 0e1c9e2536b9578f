"""One browser tab: its own state, its own trame server, and what the page may ask of it.

A trame server shares its state with every client that connects to it; so each connection here gets a server of its
own, which ends with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from collections.abc import Awaitable, Callable
from typing import Any

from trame_server import Server

from .layout import page
from .session import Session

Send = Callable[[bool, bytes | str], Awaitable[None]]

log = logging.getLogger(__name__)


class Tab:
    """A connection to the page; `answer` takes its messages, `close` ends all that it started."""

    def __init__(self, session: Session) -> None:
        self.key = secrets.token_urlsafe(16)
        """Names the tab in addresses of downloads."""
        self.session = session
        self._server = Server(f"explorer-{self.key}")
        self._server.client_type = "vue3"
        self._answered = 0
        self._backend: Any = None
        self._connection: Any = None
        self._running: asyncio.Task[None] | None = None

    async def open(self, send: Send) -> None:
        """Start the tab's server; `send` brings its messages to the browser."""
        server = self._server
        server.enable_module({"vue_use": ["roslfExplorer"]})
        state = server.state
        state.trame__title = "roslf explore"
        state.trame__template_main = page()
        state.trame__template_error = page("gone.html")
        state.update({**self.session.page(), "tab_key": self.key, "answered": 0})
        for name in self.session.requests:
            server.controller.trigger(name)(self._handler(name))
        server.controller.on_server_bind.add(self._bound)
        self._running = asyncio.get_running_loop().create_task(
            server.start(
                exec_mode="coroutine",
                backend="generic",
                open_browser=False,
                show_connection_info=False,
                disable_logging=True,
                timeout=0,
            )
        )
        await server.ready
        self._connection = await self._backend["ws"].connect()
        self._connection.on_message(send)

    async def answer(self, binary: bool, message: Any) -> None:
        """Take one message of the browser."""
        await self._connection.send(binary, message)

    def push(self) -> None:
        """Show what has changed without being asked, such as the progress of a run."""
        with self._server.state as state:
            state.update(self.session.page())

    async def close(self) -> None:
        """End the server and everything that runs for it; may be called twice."""
        self.session.close()
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

    def _handler(self, name: str) -> Callable[..., Any]:
        def handle(*arguments: Any) -> int:
            getattr(self.session, name)(*arguments)
            self._answered += 1
            self._server.state.update({**self.session.page(), "answered": self._answered})
            return self._answered

        return handle
