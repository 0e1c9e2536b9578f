"""Work of pools, apart from the tests: each worker that does it imports this, and not pytest."""

import os
import signal


def die(_index):
    os.kill(os.getpid(), signal.SIGKILL)


def fail(index):
    return bytes(1 // 0 * index)
