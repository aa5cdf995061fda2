"""What is said of the package in several places is the same in all of them, and what is built holds what it needs."""

import importlib
import importlib.metadata
import re
import tarfile
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


PYTHONS = [name.rpartition(" :: ")[2] for name in PROJECT["project"]["classifiers"] if "Python :: 3." in name]
FIRST, LAST = PYTHONS[0], PYTHONS[-1]


def minor(version: str) -> int:
    return int(version.rpartition(".")[2])


def test_every_place_names_the_same_pythons() -> None:
    def text(*path: str) -> str:
        return ROOT.joinpath(*path).read_text(encoding="utf-8")

    workflow, lowest = text(".github", "workflows", "tests.yml"), text(".ci", "lowest")
    tested = re.findall(r'"(3\.\d+)"', re.search(r"python: \[(.*)\]", workflow)[1])  # type: ignore[index]
    assert tested == PYTHONS
    assert [minor(version) for version in PYTHONS] == list(range(minor(FIRST), minor(LAST) + 1))
    experimental = re.findall(r'python: "(3\.\d+)"\n +experimental: true', workflow)
    newest = max(map(minor, [*tested, *experimental]))
    assert PROJECT["project"]["requires-python"] == f">={FIRST},<3.{newest + 1}"
    assert f"Python {FIRST} to {LAST} " in README
    assert f"Python {FIRST} to {LAST} " in text("docs", "index.md")
    assert PROJECT["tool"]["ruff"]["target-version"] == f"py3{minor(FIRST)}"
    assert f"PYTHON:-python{FIRST} " in CI
    assert all(f"python{version} " in CI for version in PYTHONS)
    assert f"PYTHON:-python{FIRST}}}" in lowest
    assert f'python-version: "{FIRST}"\n      - run: .ci/lowest' in workflow
    base = re.search(r"^ARG BASE=.*python:(3\.\d+)-slim$", text("Containerfile"), flags=re.MULTILINE)
    assert base is not None
    assert base[1] in PYTHONS
    assert ".ci/run" in workflow


def test_a_container_is_built_from_all_that_the_wheel_needs() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert "*" in ignored, "only what is named is sent"
    kept = {line.removeprefix("!") for line in ignored if line.startswith("!")}
    needed = {
        "pyproject.toml",
        PROJECT["project"]["readme"],
        *PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"],
    }
    needed |= {"hatch_build.py", "kernels"}
    needed |= {name.partition("/")[0] for name in PROJECT["project"]["license-files"]}
    assert kept == needed


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


def test_contributing_shows_the_table_of_rooms() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (.+?) \|", text, flags=re.MULTILINE)
    shown = [{name.removesuffix(".py").rstrip("/") for name in re.findall(r"`(.+?)`", rooms)} for _, rooms in rows]
    assert [int(number) for number, _ in rows] == list(range(len(ROWS)))
    assert shown == ROWS


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    wheels = pytest.importorskip("hatchling.builders.wheel", reason="needs the extra dev")
    (path,) = wheels.WheelBuilder(str(ROOT)).build(
        directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"]
    )
    return zipfile.ZipFile(path)


def test_wheel_holds_the_package_and_its_data(wheel: zipfile.ZipFile) -> None:
    names = set(wheel.namelist())
    sources = {
        str(path.relative_to(ROOT))
        for path in (ROOT / "vip_factors").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith("_kernels")
    }
    assert "vip_factors/py.typed" in names
    assert sources <= names, f"not in the wheel: {sorted(sources - names)}"
    outside = {name for name in names if not name.startswith(("vip_factors/", "vip_factors-"))}
    assert not outside, "the wheel installs something beside the package"
    kinds = {Path(name).suffix for name in names if name.startswith("vip_factors/")}
    data = {".css", ".csv", ".html", ".js", ".json", ".md", ".npz", ".sha256", ".toml", ".txt"}
    kernels = {".so"}  # where there is a compiler
    assert kinds <= {".py", ".pyi", ".typed", *kernels, *data}, "the wheel holds files of a kind that no code reads"
    assert sum(one.compress_size for one in wheel.infolist()) < 3_000_000


def test_wheel_holds_the_licence_of_what_is_bundled(wheel: zipfile.ZipFile) -> None:
    (licences,) = {name.partition("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    for name in PROJECT["project"]["license-files"]:
        assert wheel.read(f"{licences}/licenses/{name}") == (ROOT / name).read_bytes()
    foreign = [path for path in (ROOT / "vip_factors").rglob("LICENSE*")]
    assert {str(path.relative_to(ROOT)) for path in foreign} < set(PROJECT["project"]["license-files"])
    assert "MIT" in PROJECT["project"]["license"]
    script = wheel.read("vip_factors/report/viewer/viewer.min.js").decode()
    assert "SPDX-License-Identifier: MIT" in script, "a page that is passed on carries the notice too"


def test_source_distribution_holds_what_its_tests_read(tmp_path: Path) -> None:
    sources = pytest.importorskip("hatchling.builders.sdist", reason="needs the extra dev")
    (path,) = sources.SdistBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    tops = {name.partition("/")[0] for name in names}
    there = {entry.name for entry in ROOT.iterdir() if entry.name not in (".git", ".gitignore")}
    assert {"pyproject.toml", "Containerfile", ".dockerignore", ".ci", ".github", "tests", "docs", "notebooks"} <= tops
    assert tops - there <= {"PKG-INFO", ".gitignore"}
    assert not [name for name in names if "__pycache__" in name or name.endswith((".rrd", ".pyc"))]
