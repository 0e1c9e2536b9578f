"""`python -m roslf_design` is `roslf`."""

import sys

try:
    from .cli import run
except KeyboardInterrupt:
    print("roslf: stopped", file=sys.stderr)
    sys.exit(130)

run()
