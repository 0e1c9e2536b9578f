"""Speed side by side: `python -m benchmarks` for everything, `python -m benchmarks TOPIC ...` for detail.

Without topics: peers in Pythons of their own, the same work on each side, results compared before times, scaling,
then all topics; writes benchmarks.json, table.md and index.html into the output folder.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
import sys
from pathlib import Path

from .harness.machine import processor

REPORT = Path("reports/benchmarks")
QUICK = Path("out/benchmarks-quick")
DATA = "benchmarks.json"


def topics() -> list[str]:
    """Names of the topics: files called bench_<topic>.py."""
    return sorted(path.stem.removeprefix("bench_") for path in Path(__file__).parent.glob("bench_*.py"))


def main(arguments: list[str] | None = None) -> int:
    """Run topics, or everything."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("topic", nargs="*", help=f"any of {', '.join(topics())}; default: everything, side by side")
    parser.add_argument("--quick", action="store_true", help="small sizes and few rounds, no topics: under 3 minutes")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="comparisons with this name")
    parser.add_argument("--no-topics", action="store_true", help="leave the topics out")
    parser.add_argument("--redraw", action="store_true", help="page and table again from the stored JSON")
    parser.add_argument("-o", "--output", type=Path, help=f"folder; default {REPORT}, of a quick run {QUICK}")
    parser.add_argument("--list", action="store_true", help="names of the comparisons, and go")
    chosen = parser.parse_args(arguments)
    if chosen.list:
        from .run import chosen as pick

        print("\n".join(case.name for case in pick(False, (), None)))
        return 0
    if chosen.topic:
        unknown = sorted(set(chosen.topic) - set(topics()))
        if unknown:
            parser.error(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(topics())}")
        return run_topics(chosen.topic)
    return side_by_side(chosen, parser)


def run_topics(names: list[str]) -> int:
    """The topics' own tables, in this process."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, {processor()}")
    for name in names:
        print(f"\n== {name}", flush=True)
        importlib.import_module(f"benchmarks.bench_{name}").main()
    return 0


def side_by_side(chosen: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    """Everything, or what `--only` names; parts are printed and not stored."""
    from .harness.store import check
    from .run import run_all

    output = chosen.output or (QUICK if chosen.quick else REPORT)
    if chosen.redraw:
        try:
            data = json.loads((output / DATA).read_text())
            check(data)
        except OSError as error:
            parser.error(f"{output / DATA}: {error.strerror}; a run without --redraw writes it")
        except ValueError as error:
            parser.error(f"{output / DATA}: {error}")
    else:
        names = [] if chosen.quick or chosen.no_topics or chosen.only else topics()
        try:
            data = run_all(chosen.quick, chosen.only, names, tell)
        except ValueError as error:
            parser.error(str(error))
        check(data)
        if chosen.only and chosen.output is None:
            return 0
    write(data, output)
    print(f"{output / 'index.html'}, {DATA} and table.md; {data['seconds'] / 60:.1f} min")
    return 0


def tell(text: str) -> None:
    """A line as soon as it is known."""
    print(text, flush=True)


def write(data: dict[str, object], output: Path) -> None:
    """JSON, table and page."""
    from roslf_design.design.write import write_atomically
    from roslf_design.report.html import render_html

    from .page import benchmark_report
    from .readme_table import readme_table

    output.mkdir(parents=True, exist_ok=True)
    write_atomically(output / DATA, (json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode())
    write_atomically(output / "table.md", readme_table(data).encode())
    write_atomically(output / "index.html", render_html(benchmark_report(data)).encode())


if __name__ == "__main__":
    sys.exit(main())
