"""Environments of peers: what cannot be installed is told, what is there is not made again."""

import json
import sys

import pytest

from benchmarks.harness import peers
from benchmarks.harness.peers import PEERS, Peer, install, interpreter


def test_a_package_that_cannot_be_had_is_told(tmp_path):
    peer = Peer("none", "None 1", "MIT", (str(tmp_path / "no-such-package-1.0.tar.gz"),), "none")
    found = install(peer, tmp_path)
    assert found.python is None
    assert "no-such-package" in found.reason
    assert found.to_dict()["installed"] is False


def test_a_python_that_is_not_there_is_told(tmp_path):
    found = install(Peer("old", "Old 1", "MIT", (), "old", pythons=("1.4",)), tmp_path)
    assert found.python is None
    assert "no Python 1.4" in found.reason


def test_an_environment_is_made_once_and_again_where_its_pins_change(tmp_path, monkeypatch):
    peer, made = Peer("lib", "Library", "PSF", (), "json"), []

    def make(peer, base, home, python):
        made.append((peer.packages, base))
        python.parent.mkdir(parents=True, exist_ok=True)
        python.touch()

    monkeypatch.setattr(peers, "_make", make)
    first = install(peer, tmp_path)
    assert first.python == tmp_path / "lib" / "bin" / "python"
    assert install(peer, tmp_path) == first
    assert made == [((), sys.executable)]
    install(Peer("lib", "Library", "PSF", ("other==2",), "json"), tmp_path)
    assert [packages for packages, _ in made] == [(), ("other==2",)]


def test_size_counts_packages_and_not_pip_or_byte_code(tmp_path):
    packages = tmp_path / "lib" / "python3.11" / "site-packages"
    for name, size in (("lens/core.py", 3 * 2**20), ("pip/big.py", 2**22), ("lens/core.pyc", 2**22)):
        (packages / name).parent.mkdir(parents=True, exist_ok=True)
        (packages / name).write_bytes(bytes(size))
    assert peers._weight(tmp_path) == 3


def test_no_wish_is_this_python():
    assert interpreter(()) == sys.executable
    assert interpreter(("1.4",)) is None


@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.key)
def test_peers_are_pinned_and_told_without_paths(peer):
    pinned = [name for name in (*peer.loose, *peer.packages) if "==" in name]
    version = peer.title.split()[-1]
    assert peer.key == "here" or any(name.endswith(f"=={version}") for name in pinned)
    assert "/" not in json.dumps(peers.Installed(peer, None, "reason").to_dict()["packages"])
