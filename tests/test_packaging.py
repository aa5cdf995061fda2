"""What is said about the package in several places is the same in all of them, and the wheel holds what it needs."""

import importlib
import re
import tomllib
import zipfile
from pathlib import Path

import pytest
from test_architecture import ROWS

import vip_factors

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
DOCUMENTS = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
REPOSITORY = PROJECT["project"]["urls"]["Source"]
RAW = REPOSITORY.replace("github.com", "raw.githubusercontent.com")


def readme_block(name: str) -> list[str]:
    """Steps of the fenced block after ``<!-- ci: name -->``, as .ci/run splits it."""
    found = re.findall(rf"^<!-- ci: {name} -->\n```\w*\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
    assert len(found) == 1, f"README.md: expected one block '<!-- ci: {name} -->', found {len(found)}"
    return [step for line in found[0].splitlines() for step in line.split(" && ") if step.strip()]


def test_version_is_said_once() -> None:
    assert PROJECT["project"]["version"] == vip_factors.__version__


@pytest.mark.parametrize(
    ("name", "install", "command"),
    [("run", "pip install .", "vip-factors demo"), ("develop", "pip install -e '.[dev]'", "pytest")],
)
def test_readme_blocks_are_what_ci_runs(name: str, install: str, command: str) -> None:
    assert readme_block(name) == [install, command]
    assert f"readme_step {name} 1" in CI
    assert f"readme_step {name} 2" in CI


def test_ci_has_no_install_command_of_its_own() -> None:
    assert "pip install" not in CI


def test_workflow_classifiers_and_minimum_name_the_same_pythons() -> None:
    workflow = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    matrix = re.findall(r'"(3\.\d+)"', re.search(r"python: \[(.*)\]", workflow)[1])  # type: ignore[index]
    classifiers = [name.rpartition(" :: ")[2] for name in PROJECT["project"]["classifiers"] if "Python :: 3." in name]
    assert matrix == classifiers
    assert PROJECT["project"]["requires-python"] == f">={matrix[0]}"
    assert ".ci/run" in workflow


def test_console_script_resolves() -> None:
    module, _, attribute = PROJECT["project"]["scripts"]["vip-factors"].partition(":")
    assert callable(getattr(importlib.import_module(module), attribute))


def test_documentation_names_every_command() -> None:
    commands = importlib.import_module("vip_factors.cli.main").COMMANDS
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert set(commands) == set(re.findall(r"^\| `vip-factors ([\w-]+)` \|", page, flags=re.MULTILINE))


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_to_files_lead_somewhere(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text):
        if not target.startswith(("http://", "https://")):
            assert (ROOT / target).exists(), f"{document} links to {target}, which does not exist"


def test_readme_reads_well_on_a_package_index() -> None:
    targets = re.findall(r"\]\(([^)]+)\)", README)
    assert len(targets) > 10
    for target in targets:
        assert target.startswith("https://"), f"README.md: {target}: a package index shows no relative links"
        inside = re.fullmatch(rf"(?:{REPOSITORY}/(?:blob|tree)|{RAW})/main/([^#]+)(?:#.*)?", target)
        assert inside is None or (ROOT / inside[1]).exists(), f"README.md links to {target}, which does not exist"
    assert len(README.splitlines()) < 110, "README.md: one screen of what it is, one of how"


def test_citation_is_of_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {vip_factors.__version__}\n" in text
    assert REPOSITORY in text


def test_changelog_has_its_standing_sections() -> None:
    headings = re.findall(r"^#{2,3} (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert headings[0].startswith("[Unreleased]") or headings[0].startswith(f"[{vip_factors.__version__}]")
    assert {"Added", "Scientific changes"} <= set(headings)


def test_contributing_shows_the_table_of_rooms() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (.+?) \|", text, flags=re.MULTILINE)
    shown = [{name.removesuffix(".py").rstrip("/") for name in re.findall(r"`(.+?)`", rooms)} for _, rooms in rows]
    assert [int(number) for number, _ in rows] == list(range(len(ROWS)))
    assert shown == ROWS


def test_wheel_holds_the_package_and_its_data(tmp_path: Path) -> None:
    wheels = pytest.importorskip("hatchling.builders.wheel", reason="needs the extra dev")
    (wheel,) = wheels.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    names = set(zipfile.ZipFile(wheel).namelist())
    sources = {
        str(path.relative_to(ROOT))
        for path in (ROOT / "vip_factors").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert "vip_factors/py.typed" in names
    assert sources <= names, f"not in the wheel: {sorted(sources - names)}"
    outside = {name for name in names if not name.startswith(("vip_factors/", "vip_factors-"))}
    assert not outside, "the wheel installs something beside the package"
