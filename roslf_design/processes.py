"""Processes that work for another: they end with it. Imports nothing heavy, as each imports it anew."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading


def ready_for_work() -> None:
    """Let this worker end with its parent, and quietly on Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    end_with_parent()


def end_with_parent() -> None:
    """End this process when its parent is killed and cannot say so: it would else wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait_for_it() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_it, daemon=True).start()
