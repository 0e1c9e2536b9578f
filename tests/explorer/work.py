"""Work of runs, apart from the tests: each process that does it imports this, and not pytest."""

import os
import signal
import time

from roslf_design.errors import InputError, Problem


def double(request, tell):
    tell(0.5, "half way")
    return 2 * request


def wait_for_ever(request, tell):
    tell(0.1, "waiting")
    while True:
        time.sleep(0.05)


def wait_and_refuse_to_end(request, tell):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    tell(0.1, "stubborn")
    while True:
        time.sleep(0.05)


def refuse(request, tell):
    raise InputError((Problem("grade", "is not known"),))


def stumble(request, tell):
    raise ZeroDivisionError("division by zero")


def die(request, tell):
    os._exit(7)
