"""The documentation says what the package does: its factors, its commands, its links; and its site can be built."""

import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from vip_factors.cli.main import COMMANDS, options_of
from vip_factors.cli.options import parse
from vip_factors.io.convert import FORMATS as LOG_FORMATS
from vip_factors.io.export.files import FORMATS as EXPORT_FORMATS
from vip_factors.terms.registry import CAMERA_TERMS, VIEW_TERMS, WEARER_TERMS

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md"))
NAMES = [str(path.relative_to(DOCS)) for path in PAGES]
NAVIGATION = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


def headings(page: Path) -> list[str]:
    return re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)


def test_every_factor_has_a_paragraph() -> None:
    terms = {term.kind for term in (*WEARER_TERMS, *VIEW_TERMS, *CAMERA_TERMS)}
    assert terms == {one for one in headings(DOCS / "factors.md") if one[0].islower()}


def test_every_factor_links_its_source() -> None:
    text = (DOCS / "factors.md").read_text(encoding="utf-8")
    for kind, block in re.findall(r"^### ([a-z ]+)$(.*?)(?=^##|\Z)", text, flags=re.MULTILINE | re.DOTALL):
        source = re.search(r"/blob/main/(vip_factors/terms/\w+\.py)\)", block)
        assert source is not None, kind
        assert f'"{kind}"' in (ROOT / source[1]).read_text(encoding="utf-8"), kind


def test_every_residual_is_in_the_reference() -> None:
    files = {path.stem for path in (ROOT / "vip_factors" / "terms").glob("*.py")} - {
        "__init__",
        "equations",
        "evaluation",
        "registry",
    }
    text = (DOCS / "reference" / "factors.md").read_text(encoding="utf-8")
    assert files == set(re.findall(r"^::: vip_factors\.terms\.(\w+)$", text, flags=re.MULTILINE))


def anchors(page: Path) -> set[str]:
    """As GitHub and the site make them of plain headings."""
    return {re.sub(r"[^\w\- ]", "", one.lower()).strip().replace(" ", "-") for one in headings(page)}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)]+)\)", text):
        if target.startswith(("http://", "https://")):
            inside = re.match(r"https://github\.com/vip-factors/vip_factors/(?:blob|tree)/main/([^#]+)", target)
            assert inside is None or (ROOT / inside[1]).exists(), f"{page.name}: {target} does not exist"
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name} links to {target}, which does not exist"
        assert file.is_relative_to(DOCS), f"{page.name} links to {target}: give what is not in docs/ its whole address"
        assert not anchor or anchor in anchors(file), f"{page.name} links to {target}: no such heading"


@pytest.mark.parametrize("name", NAMES)
def test_page_is_in_the_navigation(name: str) -> None:
    assert re.search(rf"[ ]{re.escape(name)}$", NAVIGATION, flags=re.MULTILINE), f"mkdocs.yml: nav lacks {name}"


def blocks(page: Path, kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```$", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[list[str]]:
    """The words after the program's name, of commands that are not for many files."""
    lines = "".join(blocks(page, "bash")).replace("\\\n", " ").splitlines()
    found = [
        shlex.split(re.split(" [|>]", line)[0], comments=True) for line in lines if line.startswith("vip-factors ")
    ]
    many = re.compile("@|s3:|estimates/")
    return [words[1:] for words in found if words[1] in COMMANDS and not any(map(many.match, words))]


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=[*NAMES, "README.md"])
def test_commands_are_understood(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tuned.toml").touch()
    for command, *words in commands(page):
        options = parse(options_of(command), f"vip-factors {command}", words)
        assert command != "convert" or (options.out is None) == (options.template is not None)


READ = {
    "xsens_txt": "Xsens MTw / MT Manager", "xsens_dot": "Xsens (Movella) DOT", "mvnx": "Xsens MVN", "apdm": "APDM Opal",
    "opensense_sto": "OpenSense, OpenSim", "opensim_export": "OpenSense, OpenSim", "table": "tables of any make",
    "ros2": "ROS 2", "totalcapture": "TotalCapture",
}  # fmt: skip


def rows(name: str) -> dict[str, str]:
    """Second by first cell of the table between the markers ``name``."""
    text = (DOCS / "formats.md").read_text(encoding="utf-8")
    table = text.partition(f"<!-- {name}: begin -->")[2].partition(f"<!-- {name}: end -->")[0]
    cells = [line.strip("| ").split(" | ") for line in table.strip().splitlines()[2:]]
    return {first: second for first, second in cells}


def test_every_format_that_is_read_is_in_the_table() -> None:
    assert set(READ) == set(LOG_FORMATS) - {"recording"}
    assert set(READ.values()) <= set(rows("formats"))


def test_every_format_that_is_written_is_in_the_table() -> None:
    assert {f"`{suffix}`" for suffix in EXPORT_FORMATS} <= set(rows("written"))


def test_findings_are_listed_as_they_are() -> None:
    page = runpy.run_path(str(DOCS / "list_findings.py"))["page"]
    assert (DOCS / "findings.md").read_text(encoding="utf-8") == page(), "run .ci/generate findings"


@pytest.mark.slow
def test_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "factors.html").read_text(encoding="utf-8")
    assert page.count("<math") > 25
    for html in tmp_path.rglob("*.html"):
        fetched = re.findall(
            r"""<(?:script|link|img|iframe)[^>]+(?:src|href)=["']?https?://[^"' >]+""", html.read_text("utf-8")
        )
        assert not fetched, f"{html.name}: comes from the network: {fetched}"
