"""One word for one thing: what people read has the glossary's words, and none that were retired for them."""

import ast
import gc
import re

import pytest

from roslf_design.words import TERMS

RETIRED = {
    r"\bturned round\b": "reversed",
    r"\bspoke\b": "used in the fit",
    r"\bmay be looser\b|\blooser grades\b": "tolerances to relax",
    r"\brests? on\b|\brested on\b": "active constraint; depends on",
    r"\bfolds? (at|beyond|back)\b|\bfolding frequency\b": "aliases above",
    r"\b(by|with|for) a ruler\b|\ba ruler('s| says| finds)\b": "mechanical distance",
    r"\broom (to spare|at the|that the rim)|\bmm of room\b|\blimit's room\b": "clearance; margin",
    r"% (are )?kept\b|\bkept (fraction|share)|\bof an image are kept\b": "unvignetted",
    r"\bruns off without end\b": "unbounded objective",
    r"\bwanted yield\b": "target yield",
    r"\b(moves|goes with) the weakest\b|\bgoes with it most\b": "sensitivity; correlation",
    r"\b[Tt]old\b(?!\s(apart|from)\b)|\btells of\b": "reported; states",
    r"\bKept\b|\bothers kept\b": "unvignetted; unchanged",
    r"\bsheets? tells?\b": "states",
    r"\bthin twins?\b": "thin-lens model",
    r"\bFeel how\b": "interactive explorer",
    r"\b[Ff]irst look\b": "default tolerances",
}
"""Words with the meaning for which they were retired, and what stands there now."""
EXCEPTIONS = {
    "kept fraction": "a key: the value of `roslf accuracy --quantity`, of Python's `choose` and of shipped tables",
}
"""Texts that stay, and why."""


def _strings(path, public):
    """Line and text of what a module says: strings, fields of public classes, and functions' docstrings if `public`."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    bare = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            fields = zip(node.body, node.body[1:], strict=False)
            bare -= {id(after.value) for field, after in fields if isinstance(field, ast.AnnAssign) and _bare(after)}
        elif public and isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and _bare(node.body[0]):
            bare -= {id(node.body[0].value)}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(str(v.value) if isinstance(v, ast.Constant) else "0" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in bare:
            yield node.lineno, node.value


def _script_strings(path):
    """Line and text of the string literals of a script; what a template puts in stands as 0."""
    script = path.read_text(encoding="utf-8")
    literal = r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|`(?:\\.|[^`\\])*`'
    for match in re.finditer(rf"//[^\n]*|/\*.*?\*/|({literal})", script, re.DOTALL):
        if match[1]:
            yield script.count("\n", 0, match.start()) + 1, re.sub(r"\$\{[^}]*\}", "0", match[1][1:-1])


def _bare(node):
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


@pytest.fixture(scope="module")
def texts(root):
    """Place and text of all that people read: messages, help, pages, documentation; not the history of changes."""
    gc.disable()  # of a tree nothing is let go before all of it: looking for what may be takes as long as parsing
    package, found = root / "roslf_design", []
    for path in sorted(package.rglob("*.py")):
        for line, text in _strings(path, path.parent.name == "commands"):
            found.append((f"{path.relative_to(root)}:{line}", text))
    for path in sorted([*(root / "studies").rglob("*.py"), *(root / "benchmarks").rglob("*.py")]):
        found += [(f"{path.relative_to(root)}:{line}", text) for line, text in _strings(path, public=False)]
    for path in sorted(package.rglob("*.js")):
        found += [(f"{path.relative_to(root)}:{line}", text) for line, text in _script_strings(path)]
    pages = [*package.rglob("*.html"), *package.rglob("*.j2"), root / "README.md", root / "CONTRIBUTING.md"]
    pages += [*(root / "docs").rglob("*.md"), root / "docs/_ext/keys.toml", *(root / "studies").rglob("README.md")]
    pages += [*(root / "studies").rglob("*.toml"), *(root / "designs").rglob("*.toml")]
    for path in sorted(pages):
        if "_build" not in path.parts and "_generated" not in path.parts:
            text = path.read_text(encoding="utf-8").partition("## Words that were retired")[0]
            found.append((str(path.relative_to(root)), text))
    gc.enable()
    return found


def test_retired_words_stay_out(texts):
    """All in one test: in each worker that had one of them, all sources would be read."""
    patterns = {re.compile(words.replace(" ", r"\s+")): instead for words, instead in RETIRED.items()}
    left = []
    for place, text in texts:
        for excepted in EXCEPTIONS:
            text = text.replace(excepted, "")
        left += [
            f"{place}: {match[0]!r}, say {instead}"
            for pattern, instead in patterns.items()
            for match in pattern.finditer(text)
        ]
    assert not left


def test_every_exception_is_needed(texts):
    for excepted in EXCEPTIONS:
        assert any(excepted in text for _, text in texts)
        assert any(re.search(words, excepted) for words in RETIRED)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("turned round the lens sees whole images", "reversed"),
        ("0.1 mm of room are missing", "clearance; margin"),
        ("cut, 62 % kept", "unvignetted"),
        ("lie within the errors told for light", "reported; states"),
        ("Do real depths repeat as told?", "reported; states"),
        ("told: 0.1 mm", "reported; states"),
        ("any one of these, all others kept, would do", "unvignetted; unchanged"),
    ],
)
def test_patterns_find_what_they_name(text, word):
    assert [RETIRED[words] for words in RETIRED if re.search(words, text)] == [word]


def test_what_scripts_say_is_read_without_their_comments(tmp_path):
    script = tmp_path / "page.js"
    script.write_text('// "no"\nsay("a \\"b\\" // c"); /* \'no\' */ x = `${n} of\n${m}`\n', encoding="utf-8")
    assert list(_script_strings(script)) == [(2, r"a \"b\" // c"), (2, "0 of\n0")]


def test_terms_of_reports_stand_in_the_glossary(root):
    rows = re.findall(r"(?m)^\| ([^|]+) \|", (root / "docs/glossary.md").read_text(encoding="utf-8"))
    glossary = {term.strip() for row in rows for term in (row, *row.split(","))}
    assert set(TERMS) <= glossary


def test_links_say_where_they_lead(texts):
    """Sphinx fills an empty link; who reads the file as it lies sees a hole."""
    assert not [place for place, text in texts if place.endswith(".md") and re.search(r"(?<!!)\[\]\(", text)]
