"""Pictures that pages show, made when the pages are: by commands that stand above them, or by code that stands there.

`{picture} FILE` takes a file that a command above it writes, or a Python session above it saves: that command runs
again, after those whose files it reads. `{drawn}` runs its Python, shows it, and shows what it draws. Both are kept
until the page or the package changes.
"""

from __future__ import annotations

import contextlib
import doctest
import hashlib
import io
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from cells import run
from docutils import nodes
from docutils.parsers.rst import directives
from page_blocks import Block, blocks, steps
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

import roslf_design
from roslf_design.cli import main
from roslf_design.errors import FAULTS

DPI = 110
"""Of figures of matplotlib."""
SUFFIXES = {"image/svg+xml": "svg", "image/png": "png"}
FAILURES = (*FAULTS, ImportError, OSError, AttributeError, subprocess.CalledProcessError)
"""How code and commands of a page fail: reported with its place, and the build goes on."""
log = logging.getLogger(__name__)


class _Made(SphinxDirective):
    """A figure whose picture is made here."""

    option_spec: ClassVar[dict[str, Any]] = {"alt": directives.unchanged_required}

    @property
    def page(self) -> Path:
        return Path(self.env.doc2path(self.env.docname))

    def figure(self, made_of: str, make: Callable[[], tuple[str, bytes]], caption: str) -> list[nodes.Node]:
        """The picture as a figure, made unless what it is made of has made it before."""
        stem = f"{self.env.docname.replace('/', '-')}-{_digest(made_of)}"
        folder = Path(self.env.srcdir) / "_generated" / "pictures"
        kept = sorted(folder.glob(f"{stem}.*"))
        if not kept:
            log.info("picture of line %s of %s", self.lineno, self.env.docname)
            try:
                suffix, content = make()
            except FAILURES as error:
                raise self.error(f"no picture: {type(error).__name__}: {error}") from error
            folder.mkdir(parents=True, exist_ok=True)
            kept = [folder / f"{stem}.{suffix}"]
            kept[0].write_bytes(content)
        alt = self.options.get("alt", caption).replace("\n", " ")
        text = f"```{{figure}} /_generated/pictures/{kept[0].name}\n:alt: {alt}\n\n{caption}\n```"
        return self.parse_text_to_nodes(text)


class CommandPicture(_Made):
    """A file that commands above write; the content is its caption."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Nodes of the figure."""
        file = self.arguments[0]
        above = [block for block in blocks(self.page) if block.line < self.line_of(f"{{picture}} {file}")]
        todo = _needed(above, file)

        def make() -> tuple[str, bytes]:
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                names: dict[str, Any] = {}
                for block, commands in todo:
                    _follow(block, commands, names)
                return Path(file).suffix[1:], (Path(folder) / file).read_bytes()

        return self.figure(f"{file}\n{todo}", make, "\n".join(self.content))

    def line_of(self, text: str) -> int:
        """Line of the page where a text stands first."""
        before, found, _ = self.page.read_text(encoding="utf-8").partition(text)
        assert found
        return before.count("\n") + 1


class DrawnPicture(_Made):
    """Python that draws something, shown with what it draws; the argument is the caption."""

    optional_arguments = 1
    final_argument_whitespace = True
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Nodes of the code and of the figure."""
        code = "\n".join(self.content)
        above = [block for block in blocks(self.page) if block.caption and block.line < self.lineno]

        def make() -> tuple[str, bytes]:
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                for block in above:
                    _follow(block, [], {})
                return drawn(code)

        shown = self.parse_text_to_nodes(f"```python\n{code}\n```")
        caption = self.arguments[0] if self.arguments else ""
        return [*shown, *self.figure(f"{code}\n{above}", make, caption)]


def drawn(code: str) -> tuple[str, bytes]:
    """Suffix and content of the last picture that Python code shows.

    Raises
    ------
    ValueError
        It shows none.
    """
    import base64

    for output in reversed(run(code, {}, DPI)):
        for kind, suffix in SUFFIXES.items():
            if content := "".join(output.get("data", {}).get(kind, "")):
                return suffix, base64.b64decode(content) if suffix == "png" else content.encode()
    raise ValueError("the code draws nothing")


def _needed(above: list[Block], file: str) -> list[tuple[Block, list[str]]]:
    """Blocks to follow for a file, each with those of its commands that write it, or what these read."""
    todo: list[tuple[Block, list[str]]] = []
    wanted, sessions = {file}, True
    for block in reversed(above):
        commands = []
        if block.language == "console":
            for command, _ in reversed(steps(block.text)):
                words = shlex.split(command)
                written = words[words.index("-o") + 1] if "-o" in words else ""
                if words[0] == "python" or (written and any(_writes(written, one) for one in wanted)):
                    commands.insert(0, command)
                    sessions = sessions and words[0] == "python"
                    wanted |= {word for word in words[1:] if word not in ("-o", written)}
        if commands or block.caption or (block.language == "pycon" and sessions):
            todo.insert(0, (block, commands))
    return todo


def _writes(written: str, file: str) -> bool:
    """Whether a command with this output writes a file, one that is named after it, or in it, or something in it."""
    target, wanted = Path(written), Path(file)
    named = target.parent == wanted.parent and wanted.name.startswith(target.stem)
    return named or target in wanted.parents or wanted in target.parents


def _follow(block: Block, commands: list[str], names: dict[str, Any]) -> None:
    """Do in the working folder what a block says: write its file, run these of its commands, or its session."""
    if block.caption:
        Path(block.caption).write_text(block.text, encoding="utf-8")
    for command in commands:
        words = shlex.split(command)
        said = io.StringIO()
        if words[0] == "python":
            subprocess.run([sys.executable, *words[1:]], check=True, capture_output=True)
            continue
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = main(words[1:])
        if code:
            raise RuntimeError(f"`{command}` ends with {code}: {said.getvalue()}")
    if block.language == "pycon":
        for example in doctest.DocTestParser().get_examples(block.text):
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile(example.source, "<page>", "single"), names)


@cache
def _package() -> bytes:
    """Digest of the package and of the designs that ship."""
    root = Path(roslf_design.__file__).parent
    files = sorted([*root.rglob("*.py"), *root.parent.glob("designs/*.toml")])
    return hashlib.blake2b(b"".join(path.read_bytes() for path in files)).digest()


def _digest(text: str) -> str:
    return hashlib.blake2b(_package() + text.encode(), digest_size=8).hexdigest()


def setup(app: Sphinx) -> dict[str, Any]:
    """Both kinds of pictures."""
    app.add_directive("picture", CommandPicture)
    app.add_directive("drawn", DrawnPicture)
    return {"parallel_read_safe": False}
