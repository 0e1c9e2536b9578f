"""What the project says of itself in several places is the same in all."""

import re
import tomllib

import yaml

import roslf_design
from roslf_design.design import preset_names


def test_one_version(root):
    version = roslf_design.__version__
    citation = yaml.safe_load((root / "CITATION.cff").read_text())
    assert citation["version"] == version
    assert "version" in tomllib.loads((root / "pyproject.toml").read_text())["project"]["dynamic"]
    newest = re.search(r"(?m)^## (\d\S*)", (root / "CHANGELOG.md").read_text())
    assert newest is not None
    assert newest[1] == version


def test_citation_names_software_and_paper(root):
    citation = yaml.safe_load((root / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(citation)
    assert citation["license"] == "MIT"
    (paper,) = citation["references"]
    assert paper["type"] == "article"
    assert [author["family-names"] for author in paper["authors"]] == ["Zhou", "Chen", "Xu", "Xu"]


def test_pages_are_all_in_the_contents(root):
    docs = root / "docs"
    folders, alone = "guides|theory|reference|coming-from|notebooks", "contributing|changelog|gallery|glossary"
    listed = set(re.findall(rf"(?m)^((?:{folders})/\S+|{alone})$", (docs / "index.md").read_text()))
    pages = {
        page.relative_to(docs).with_suffix("").as_posix()
        for page in (*docs.rglob("*.md"), *docs.rglob("*.ipynb"))
        if not page.relative_to(docs).parts[0].startswith("_")
    }
    assert pages - {"index"} == listed


def test_changelog_counts_the_presets(root):
    words = ("six", "seven", "eight", "nine", "ten", "eleven", "twelve")
    assert f"{words[len(preset_names()) - 6]} presets" in " ".join((root / "CHANGELOG.md").read_text().split())


def test_keys_described_on_the_pages_are_those_of_classes_there_are(root):
    """A class of another name would leave its table of the reference without words, and the pages unbuilt."""
    code = "\n".join(path.read_text() for path in (root / "roslf_design").rglob("*.py"))
    classes = set(re.findall(r"(?m)^class (\w+)", code))
    described = tomllib.loads((root / "roslf_design/reporting/keys.toml").read_text())
    assert {name for name in described if not name.startswith("[")} <= classes
    assert tomllib.loads((root / "docs/_ext/keys.toml").read_text())
