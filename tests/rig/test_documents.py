"""The documents beside the code: what they name exists, and what programs read of them can be read."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[2]
DOCUMENTS = (
    "README.md",
    "CONTRIBUTING.md",
    *(f"docs/{page.name}" for page in (REPOSITORY / "docs").glob("*.md")),
)
ROOMS = ("imaging", "drivers", "capture", "calib", "recon", "rig", "bench", "tests", "docs")
PLACE = re.compile(rf"(?<![\w/.])(?:(?:{'|'.join(ROOMS)})/[\w./-]*|[A-Z][A-Z]+\.(?:md|cff)|pyproject\.toml)")
"""A folder or a file of the repository, as sentences name it; NAME stands for one that is to be written."""


def places(document: str) -> set[str]:
    """Names of a document that belong to the repository."""
    text = (REPOSITORY / document).read_text(encoding="utf-8")
    mentioned = {place.rstrip(".") for place in PLACE.findall(text)}
    return {place for place in mentioned if "NAME" not in place}


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_place_that_a_document_names_is_there(document: str) -> None:
    named = places(document)
    missing = sorted(place for place in named if not (REPOSITORY / place).exists())
    assert not missing, f"{document} names {missing}"


def test_places_are_found_in_the_documents() -> None:
    assert {"recon/train/trainer.py", "drivers/ptp/vendors/", "pyproject.toml"} <= places(
        "docs/architecture.md"
    )
    assert {"docs/glossary.md", "CITATION.cff", "bench/results/"} <= places("CONTRIBUTING.md")


def test_extras_are_installed_from_where_rig_is() -> None:
    """No package index knows rig: what tells how to get an extra names one that pyproject.toml has."""
    extras = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    texts = [REPOSITORY / document for document in DOCUMENTS]
    texts += [path for room in ROOMS for path in (REPOSITORY / room).rglob("*.py")]
    named = {}
    for path in texts:
        words = path.read_text(encoding="utf-8")
        assert not re.search(r"hdr-rig" + r"\[", words), f"{path} names a package that no index has"
        named |= dict.fromkeys(re.findall(r"pip install -e '\.\[([a-z0-9,]+)\]'", words), path)
    assert {"usd", "mesh", "video", "cluster", "gphoto2"} <= named.keys() <= extras.keys()


def test_the_names_that_contributors_are_given_are_in_the_code() -> None:
    words = re.findall(
        r"`(?:\w+\.)?(\w+)(?:\([^`]*\))?(?: -> \w+)?`", (REPOSITORY / "CONTRIBUTING.md").read_text()
    )
    named = {word for word in words if re.search(r"[A-Z_]", word)} - {"NAME", "PHOTOS"}
    code = {
        word
        for stage in ("imaging", "drivers", "capture", "calib", "recon", "rig", "tests")
        for path in (REPOSITORY / stage).rglob("*.py")
        for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))
    }
    assert {"StandardBody", "METHODS", "is_one", "LayoutName"} <= named
    assert sorted(named - code) == []


def test_the_architecture_names_every_room() -> None:
    named = places("docs/architecture.md")
    packages = {
        f"{folder.parent.relative_to(REPOSITORY)}/"
        for stage in ("imaging", "capture", "calib", "recon", "rig")
        for folder in (REPOSITORY / stage).glob("*/__init__.py")
    }
    assert sorted(packages - named) == []


def test_the_citation_is_of_this_version_and_its_notes_name_files() -> None:
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert citation["cff-version"] == "1.2.0"
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    assert citation["authors"] == project["authors"]
    for paper in citation["references"]:
        assert paper["type"]
        assert paper["title"]
        assert paper["authors"]
        for place in PLACE.findall(paper["notes"]):
            assert (REPOSITORY / place).exists(), place


def test_papers_that_the_code_cites_by_number_are_in_the_citation() -> None:
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    cited = {
        number
        for stage in ("imaging", "drivers", "capture", "calib", "recon", "rig")
        for path in (REPOSITORY / stage).rglob("*.py")
        for number in re.findall(r"arXiv\s+(\d{4}\.\d{5})", path.read_text(encoding="utf-8"))
    }
    assert cited
    assert {number for number in cited if f"arXiv:{number}" not in citation} == set()


def test_the_changelog_has_this_version() -> None:
    version = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["version"]
    assert f"## [{version}]" in (REPOSITORY / "CHANGELOG.md").read_text()


def test_hooks_fetch_nothing() -> None:
    hooks = yaml.safe_load((REPOSITORY / ".pre-commit-config.yaml").read_text())
    assert [repo["repo"] for repo in hooks["repos"]] == ["local"]
    assert {hook["language"] for repo in hooks["repos"] for hook in repo["hooks"]} == {"system"}
