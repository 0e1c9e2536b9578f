"""The explorer as a process: where it listens, whom it answers, how it ends."""

import asyncio
import signal
import socket
import urllib.error
import urllib.request
from pathlib import Path

import aiohttp
import msgpack
import pytest

from roslf_design.cli import main
from roslf_design.commands import explore as command
from roslf_design.explorer.server import FIRST_PORT, is_local
from tests.explorer.conftest import Explorer


def asked(address, **headers):
    """Status and text of the answer to a plain request."""
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=10) as answer:
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


def test_without_a_port_the_next_free_one_is_taken_and_all_ends_when_asked():
    one, two = Explorer(), Explorer()
    ports = [int(running.address.rsplit(":", 1)[1].strip("/")) for running in (one, two)]
    assert FIRST_PORT <= ports[0] < ports[1]
    for running, number in ((one, signal.SIGHUP), (two, signal.SIGINT)):  # SIGTERM ends the one that tests share.
        assert asked(running.address)[0] == 200
        assert len(running.processes()) == 1
        assert running.end(number) == 0
        assert running.stderr == ""
        assert running.processes() == []


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
    for odd in ("[", "[::1", "a]b"):
        assert asked(explorer.address, Host=odd)[0] in (400, 403), odd


@pytest.mark.parametrize("message", [b"", b"x" * 40, "text", msgpack.packb(3), b"0" * 12 + msgpack.packb({"id": 1})])
def test_what_is_no_message_ends_its_connection_and_no_other(explorer, message):
    async def send():
        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(f"{explorer.address}ws") as other,
            client.ws_connect(f"{explorer.address}ws") as connection,
        ):
            await (connection.send_str(message) if isinstance(message, str) else connection.send_bytes(message))
            answer = await connection.receive(timeout=10)
            return answer.type, connection.close_code, other.closed

    assert asyncio.run(send()) == (aiohttp.WSMsgType.CLOSE, aiohttp.WSCloseCode.UNSUPPORTED_DATA, False)
    assert asked(explorer.address)[0] == 200


def test_files_of_a_closed_tab_and_files_that_are_not_there_are_refused(explorer):
    assert asked(f"{explorer.address}tab/nobody/design.toml")[0] == 404
    assert asked(f"{explorer.address}page/../server.py")[0] == 404
    assert asked(f"{explorer.address}page/%2e%2e/server.py")[0] in (403, 404)


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
