"""Figures of how the package is built, held against those that are kept: they may fall, not grow.

    python tests/house.py               compare with tests/house.json; exit code 1 where a figure grew
    python tests/house.py --list NAME   the places behind one figure
    python tests/house.py --write       keep the figures as they are now

kind_questions    lines that ask a camera, a design or a part what kind it is
part_loops        loops over elements, stops or rims
climbs            imports from a lower floor to a higher one, those for types included
circles           groups of files that import each other, those for types included
inner_imports     imports of the package's own modules inside functions
classes_twice     public class names that stand twice
bags              classes of fields alone, without a method
long_functions    functions of more than 80 lines, docstring apart
many_parameters   functions of more than 8 parameters, kernels apart
private_public    public functions and classes that only their own file uses
nounless          docstrings that begin with "The same", "Of", "That", "Those" or "What"
"""

from __future__ import annotations

import argparse
import ast
import gc
import json
import re
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = "roslf_design"
KEPT = Path(__file__).with_suffix(".json")

KINDS = re.compile(
    r"\b(lens|prescription|chain|ahead|train|outside|elements|law) is (not )?None"
    r"|isinstance\(.*\b(Plate|Prism|Block|FieldLens|LensGroup|Grin|Rod|LensImages|LensCamera|IdealLens|RealLens)\b"
    r"|\.(tilted|aligned)\b|[!=]= ['\"]hexagonal['\"]|\blens_shape\b\s*[!=]=|[!=]= ['\"]mono['\"]"
    r"|\bif (not )?(\w+\.)+(chain|elements|lens|law)\b\s*(:|else|and|or|\))"
)
LOOPS = re.compile(r"\bfor\b[^:]*\bin\b[^:]*\b(design\.elements|elements|stops|rims|faces)\b(?!\s*=)")
NOUNLESS = re.compile(r"(The same\b|Of |That |Those |What )")
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
LONGEST = 80
MOST_PARAMETERS = 8


class Module:
    """One file of the package, parsed."""

    def __init__(self, path: Path) -> None:
        self.place = str(path.relative_to(ROOT))
        self.text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text)
        parts = path.relative_to(ROOT).with_suffix("").parts
        self.package = parts[:-1]
        self.name = ".".join(self.package if parts[-1] == "__init__" else parts)

    @cached_property
    def nodes(self) -> list[tuple[ast.AST, bool]]:
        """Every statement, with whether it stands inside a function."""
        found: list[tuple[ast.AST, bool]] = [(self.tree, False)]
        for node, inside in found:
            deeper = inside or isinstance(node, FUNCTIONS)
            found += ((child, deeper) for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr))
        return found

    def docstrings(self) -> Iterator[ast.Expr]:
        """Docstrings of modules, classes, functions and fields."""
        for node, _ in self.nodes:
            for item in node.body if isinstance(node, (ast.Module, ast.ClassDef, *FUNCTIONS)) else ():
                if (
                    isinstance(item, ast.Expr)
                    and isinstance(item.value, ast.Constant)
                    and isinstance(item.value.value, str)
                ):
                    yield item

    def imported(self, node: ast.AST, modules: Iterable[str]) -> set[str]:
        """Modules of the package that an import statement reads."""
        if isinstance(node, ast.Import):
            names = {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = self.package[: len(self.package) - node.level + 1] if node.level else ()
            base = ".".join([*above, *([node.module] if node.module else [])])
            full = {alias.name: f"{base}.{alias.name}" for alias in node.names}
            names = {name if name in modules else base for name in full.values()}
        else:
            return set()
        return {name for name in names if name in modules and name != self.name}

    def code(self) -> Iterator[tuple[int, str]]:
        """Lines that are neither blank nor comment, docstring or import, with their numbers."""
        left_out: set[int] = set()
        imports = (node for node, _ in self.nodes if isinstance(node, (ast.Import, ast.ImportFrom)))
        for node in chain(self.docstrings(), imports):
            left_out |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        for number, line in enumerate(self.text.splitlines(), 1):
            if line.strip() and not line.lstrip().startswith("#") and number not in left_out:
                yield number, line


def is_kernel(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("kernel" in ast.unparse(decorator) for decorator in function.decorator_list)


def floors() -> dict[str, int]:
    """Floor of each room by import-linter's contract, 0 the highest."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return {room.strip(): floor for floor, layer in enumerate(layers) for room in re.split(r"[|:]", layer)}


def circles(edges: dict[str, set[str]]) -> list[str]:
    """Groups of modules each of which reaches all others of its group."""

    def reached(start: str) -> frozenset[str]:
        met, todo = set(), [start]
        while todo:
            fresh = edges[todo.pop()] - met
            met |= fresh
            todo += fresh
        return frozenset(met)

    ways = {module: reached(module) for module in list(edges)}
    groups = {frozenset(b for b in ways[a] if a in ways.get(b, ())) for a in ways if a in ways[a]}
    return [" ".join(sorted(group)) for group in groups]


def figures() -> dict[str, list[str]]:
    """Places behind each figure."""
    modules = [Module(path) for path in sorted((ROOT / PACKAGE).rglob("*.py"))]
    names = {module.name for module in modules}
    words = {module.name: Counter(re.findall(r"\w+", module.text)) for module in modules}
    edges: dict[str, set[str]] = defaultdict(set)
    places: dict[str, list[str]] = defaultdict(list)
    classes: Counter[str] = Counter()
    for module in modules:
        for node, inside in module.nodes:
            own = module.imported(node, names)
            edges[module.name] |= own
            at = f"{module.place}:{getattr(node, 'lineno', 0)}"
            if own and inside:
                places["inner_imports"].append(at)
            if isinstance(node, ast.ClassDef):
                classes[node.name] += not node.name.startswith("_")
                fields = any(isinstance(item, ast.AnnAssign) for item in node.body)
                if fields and not any(isinstance(item, FUNCTIONS) for item in node.body):
                    places["bags"].append(f"{at} {node.name}")
            if isinstance(node, FUNCTIONS):
                text = ast.get_docstring(node, clean=False)
                size = (node.end_lineno or 0) - node.lineno + 1 - (text.count("\n") + 1 if text else 0)
                if size > LONGEST:
                    places["long_functions"].append(f"{at} {node.name} {size}")
                given = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                count = len(given) - (given[:1] in (["self"], ["cls"]))
                if count > MOST_PARAMETERS and not is_kernel(node):
                    places["many_parameters"].append(f"{at} {node.name} {count}")
        for item in module.tree.body:
            public = isinstance(item, (ast.FunctionDef, ast.ClassDef)) and not item.name.startswith("_")
            if public and not any(words[other][item.name] for other in names if other != module.name):
                places["private_public"].append(f"{module.place}:{item.lineno} {item.name}")
        for line in module.docstrings():
            if isinstance(line.value, ast.Constant) and NOUNLESS.match(str(line.value.value).strip()):
                places["nounless"].append(f"{module.place}:{line.lineno}")
        for number, line in module.code():
            bare = re.sub(r"\s#.*", "", line)
            for figure, pattern in (("kind_questions", KINDS), ("part_loops", LOOPS)):
                if pattern.search(bare):
                    places[figure].append(f"{module.place}:{number} {line.strip()[:100]}")
    floor = floors()
    of = {name: floor.get(name, floor.get(".".join(name.split(".")[:2]))) for name in names}
    for above, below in ((a, b) for a, reads in edges.items() for b in reads):
        high, low = of[above], of[below]
        if high is not None and low is not None and low < high:
            places["climbs"].append(f"{above} -> {below}")
    places["circles"] = circles(edges)
    places["classes_twice"] = [name for name, count in classes.items() if count > 1]
    return places


def main() -> int:
    gc.disable()  # looking for what goes, of which there is nothing, takes half of the time
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", metavar="NAME", help="print the places behind one figure")
    parser.add_argument("--write", action="store_true", help="keep the figures as they are now")
    options = parser.parse_args()
    places = figures()
    if options.list:
        print("\n".join(places[options.list]))
        return 0
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    counts = {name: len(places[name]) for name in re.findall(r"^(\w+)   ", str(__doc__), re.MULTILINE)}
    if options.write:
        KEPT.write_text(json.dumps(counts, indent=2) + "\n")
        return 0
    grown = [name for name, count in counts.items() if count > kept.get(name, 0)]
    for name in grown:
        print(f"{name}: {kept.get(name, 0)} -> {counts[name]}; python tests/house.py --list {name}")
    fallen = [f"{name} {kept[name]} -> {count}" for name, count in counts.items() if count < kept.get(name, 0)]
    if fallen:
        print(f"Fewer than kept, so keep that: python tests/house.py --write ({', '.join(fallen)})")
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
