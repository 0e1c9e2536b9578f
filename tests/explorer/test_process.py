"""The explorer as a process: where it listens, whom it answers, how it ends."""

import asyncio
import contextlib
import os
import signal
import socket
import struct
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import aiohttp
import msgpack
import pytest

from roslf_design.cli import main
from roslf_design.commands import explore as command
from roslf_design.explorer.server import FIRST_PORT, PORTS, is_local
from tests.explorer.conftest import Explorer


def asked(address, **headers):
    """Status and text of the answer to a plain request."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def test_it_listens_on_this_machine_only(explorer):
    port = int(explorer.address.rsplit(":", 1)[1].strip("/"))
    listening = set()
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            if state == "0A" and int(local.split(":")[1], 16) == port:
                listening.add(local.split(":")[0])
    assert listening == {"0100007F"}


def test_a_port_in_use_is_told(capsys):
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["explore", "--port", str(port), "--no-browser"]) == 2
    assert f"--port: {port} is in use; name another, or leave it out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--host", "203.0.113.7"], "--host: 203.0.113.7 is not an address of this machine"),
        (["--host", "no such host"], "--host: no such host is not an address"),
        (["nothing.toml"], "nothing.toml: no such file"),
        (["--port", "70000"], "--port: 70000 is not a port"),
    ],
)
def test_what_cannot_be_served_is_told_in_one_line(capsys, arguments, told):
    assert main(["explore", *arguments, "--no-browser"]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


def test_missing_packages_are_told_with_their_command(capsys, monkeypatch):
    monkeypatch.setattr(command, "PACKAGES", ("trame", "trame_not_here"))
    assert main(["explore", "--no-browser"]) == 2
    assert "pip install trame-not-here" in capsys.readouterr().err


def test_requests_by_a_foreign_name_or_from_a_foreign_page_are_refused(explorer):
    assert asked(explorer.address)[0] == 200
    status, text = asked(explorer.address, Host="evil.example")
    assert (status, "this machine's address" in text) == (403, True)

    async def connect(origin, **headers):
        async with aiohttp.ClientSession() as client:
            try:
                async with client.ws_connect(f"{explorer.address}ws", origin=origin, headers=headers):
                    return 101
            except aiohttp.WSServerHandshakeError as error:
                return error.status

    port = explorer.address.rsplit(":", 1)[1].strip("/")
    for foreign in ("http://evil.example", f"http://127.0.0.1:{int(port) + 1}", "null", "http://[", ""):
        assert asyncio.run(connect(foreign)) == 403, foreign
    # A name of someone else's, bound to this machine: host and origin agree.
    assert asyncio.run(connect(f"http://evil.example:{port}", Host=f"evil.example:{port}")) == 403
    assert asyncio.run(connect(explorer.address.strip("/"))) == 101
    # Not by the name's end alone, nor of another scheme.
    for foreign in (f"http://evil.example/://127.0.0.1:{port}", f"file://127.0.0.1:{port}", f"//127.0.0.1:{port}"):
        assert asyncio.run(connect(foreign)) == 403, foreign


def test_a_host_is_read_strictly(explorer):
    port = explorer.address.rsplit(":", 1)[1].strip("/")
    own = ("127.0.0.1", "localhost", "LocalHost", "[::1]", socket.gethostname(), "192.168.1.5")
    for host in own:
        for name in (host, f"{host}:{port}"):
            assert asked(explorer.address, Host=name)[0] == 200, name
    foreign = ("evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "127.1", "2130706433", "0x7f000001")
    odd = (
        "[",
        "[::1",
        "a]b",
        "::1",
        "[127.0.0.1]",
        "[localhost]",
        "[::1]x",
        "127.0.0.1:",
        "127.0.0.1:x",
        "localhost:0",
    )
    odd += ("127.0.0.1:65536", "127.0.0.1:80:80", "127.0.0.1/", "127.0.0.1 x", "127.0.0.1#x", "127.0.0.1?x", ":80")
    more = [f"{host}{between}{other}" for host in own[:4] for other in ("evil.example", f"{host}:{port}", "")
            for between in (",", ", ", "@", ";", "\\", "%00")]  # fmt: skip
    more += [f"evil.example{between}127.0.0.1:{port}" for between in (",", ", ", "@", ":80@", "#", "/", "\\", ":")]
    for name in (*foreign, *odd, *more):
        assert asked(explorer.address, Host=name)[0] in (400, 403), name


def test_of_several_hosts_none_is_taken(explorer):
    port = int(explorer.address.rsplit(":", 1)[1].strip("/"))
    for second in ("evil.example", f"127.0.0.1:{port}"):
        with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
            connection.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nHost: {second}\r\n\r\n".encode())
            assert connection.recv(100).split()[1] in (b"400", b"403")


@pytest.mark.parametrize("message", [b"", b"x" * 40, "text", msgpack.packb(3), b"0" * 12 + msgpack.packb({"id": 1})])
def test_what_is_no_message_ends_its_connection_and_no_other(explorer, message):
    async def send():
        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(f"{explorer.address}ws") as other,
            client.ws_connect(f"{explorer.address}ws") as connection,
        ):
            await (connection.send_str(message) if isinstance(message, str) else connection.send_bytes(message))
            answer = await connection.receive(timeout=60)
            return answer.type, connection.close_code, other.closed

    assert asyncio.run(send()) == (aiohttp.WSMsgType.CLOSE, aiohttp.WSCloseCode.UNSUPPORTED_DATA, False)
    assert asked(explorer.address)[0] == 200


def test_files_of_a_closed_tab_and_files_that_are_not_there_are_refused(explorer):
    assert asked(f"{explorer.address}tab/nobody/design.toml")[0] == 404
    assert asked(f"{explorer.address}page/../server.py")[0] == 404
    assert asked(f"{explorer.address}page/%2e%2e/server.py")[0] in (403, 404)


NAMES = (
    *("x" * 300, "x" * 4000, "/".join(["x" * 200] * 20), "%C3%A9" * 200, "%00", "a%00b", "%ff", "%ed%a0%80", "%0a"),
    *("%2e%2e%2fserver.py", "..%2f" * 9 + "etc%2fpasswd", "%2fetc%2fpasswd", "..%5cserver.py", "con", "explorer.css/x"),
)


@pytest.mark.parametrize("folder", ["page", "client", "vtk", "tab/nobody"])
def test_names_that_the_system_refuses_are_of_no_file(explorer, folder):
    for name in NAMES:
        assert asked(f"{explorer.address}{folder}/{name}")[0] == 404, name


def rpc(number, method, *arguments):
    """A message as the page sends it."""
    kind = "system" if method == "wslink.hello" else "rpc"
    call = {"wslink": "1.0", "id": f"{kind}:c0:{number}", "method": method, "args": list(arguments), "kwargs": {}}
    body = msgpack.packb(call)
    return struct.pack("<III", number, 0, len(body)) + body


def tabs_go_in_the_midst_of_an_answer(address):
    port = int(address.rsplit(":", 1)[1].strip("/"))

    async def connect_and_break(moment):
        async with aiohttp.ClientSession() as client:
            connection = await client.ws_connect(f"{address}ws")
            await connection.send_bytes(rpc(1, "wslink.hello", {"secret": "wslink-secret"}))
            await connection.send_bytes(rpc(2, "trame.trigger", "opened", ["", "light", {}], {}))
            await connection.send_bytes(rpc(3, "trame.trigger", "look", ["tab", "space"], {}))
            await asyncio.sleep(moment)
            abrupt = struct.pack("ii", 1, 0)  # closed by a reset
            connection.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, abrupt)
            connection._response.connection.transport.abort()

    def request_and_break(path, more=""):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{more}\r\n".encode())
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    key = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    key += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
    for moment in (0.0, 0.01, 0.05, 0.2, 0.5):
        asyncio.run(connect_and_break(moment))
        request_and_break("/vtk/trame-vtk.js")
        request_and_break("/ws", key)
    with socket.create_connection(("127.0.0.1", port), timeout=60) as connection:
        connection.sendall(b"no request\r\n\r\n")
        assert connection.recv(100).split()[1] == b"400"
    assert asked(address)[0] == 200


def test_without_a_port_the_next_free_one_is_taken_and_all_ends_when_asked_without_a_word_of_tabs_that_are_gone():
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):  # it is in use already
            taken.bind(("127.0.0.1", FIRST_PORT))
            taken.listen()
        running = Explorer()
    assert FIRST_PORT < int(running.address.rsplit(":", 1)[1].strip("/")) < FIRST_PORT + PORTS
    tabs_go_in_the_midst_of_an_answer(running.address)
    assert len(running.processes()) == 1
    assert running.end(signal.SIGHUP) == 0  # SIGTERM ends the one that tests share, SIGINT the one below
    assert running.stderr == ""
    assert running.processes() == []


WINDOWS = """
import asyncio, os, signal, sys
lacking = {signal: ("SIGHUP", "SIGKILL", "pthread_sigmask"), os: ("fork", "killpg", "sched_getaffinity")}
for module, names in lacking.items():
    for name in names:
        delattr(module, name)
sys.modules.update(dict.fromkeys(("fcntl", "pty", "pwd", "grp", "resource", "termios")))
def refuse(*_):
    raise NotImplementedError
for loop in (asyncio.SelectorEventLoop, asyncio.AbstractEventLoop):
    loop.add_signal_handler = loop.remove_signal_handler = refuse
"""
"""What Windows has not is taken away as Python starts."""


@pytest.fixture
def windows(monkeypatch, tmp_path):
    (tmp_path / "sitecustomize.py").write_text(WINDOWS)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])]))


def test_it_starts_and_ends_where_the_system_has_no_signals_of_unix(windows):
    running = Explorer("--port", "0")
    assert asked(running.address)[0] == 200
    assert running.end(signal.SIGINT) == 0  # Ctrl-C
    assert running.stderr == ""


def test_workers_run_where_the_system_has_no_signals_of_unix(windows):
    script = (
        "from roslf_design.commands.tolerance import _workers\n"
        "from roslf_design.tolerancing.run import WorkerSettings, run_chunks\n"
        "print(_workers(99) >= 1, sorted(run_chunks(bytes, [1, 2], WorkerSettings(2))))"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (ran.stdout, ran.stderr) == ("True [(1, b'\\x00'), (2, b'\\x00\\x00')]\n", "")


def test_the_page_may_load_nothing_from_elsewhere(explorer):
    with urllib.request.urlopen(explorer.address) as answer:
        policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy.replace(explorer.address.strip("/").replace("http", "ws"), "")


@pytest.mark.parametrize(
    ("host", "local"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False), ("192.168.1.5", False), ("x", False)],
)
def test_who_reaches_an_address(host, local):
    assert is_local(host) is local
