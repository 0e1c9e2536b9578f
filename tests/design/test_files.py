"""Files that are written whole, and are on disk when that is said."""

import errno
import os
import stat

import pytest

from roslf_design.design.files import write_atomically


@pytest.fixture
def calls(monkeypatch):
    """What is asked of the system, in order: whether a file or a folder is synced, and renaming."""
    asked = []
    sync, replace = os.fsync, os.replace

    def synced(handle):
        asked.append("folder" if stat.S_ISDIR(os.fstat(handle).st_mode) else f"file of {os.fstat(handle).st_size}")
        sync(handle)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", lambda *names: asked.append("renamed") or replace(*names))
    return asked


def test_content_is_on_disk_before_the_name_is_and_then_the_name(tmp_path, calls):
    write_atomically(tmp_path / "a.txt", b"12345")
    assert calls == ["file of 5", "renamed", "folder"]
    assert (tmp_path / "a.txt").read_bytes() == b"12345"


def test_a_disk_that_fails_leaves_the_file_as_it_was(tmp_path, monkeypatch):
    def fail(handle):
        raise OSError(errno.EIO, "Input/output error")

    write_atomically(tmp_path / "a.txt", b"old")
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="cannot be written: Input/output error"):
        write_atomically(tmp_path / "a.txt", b"new")
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("a.txt", b"old")]


def test_folders_that_cannot_be_opened_are_written_to_all_the_same(tmp_path, monkeypatch):
    opened = os.open

    def refuse(name, flags, *more, **others):
        if os.path.isdir(name):
            raise PermissionError(errno.EACCES, "Permission denied", str(name))
        return opened(name, flags, *more, **others)

    monkeypatch.setattr(os, "open", refuse)  # as on Windows
    write_atomically(tmp_path / "a.txt", b"new")
    assert (tmp_path / "a.txt").read_bytes() == b"new"
