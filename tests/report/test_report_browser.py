"""The page in a browser: its script runs without an error, finds the motion, and asks for nothing."""

import re
import shutil
import subprocess
from hashlib import sha256
from pathlib import Path

import pytest
from scene_sample import estimate_of, scene_sample

import vip_factors
from vip_factors.report.page import write_report

VIEWER = Path(vip_factors.__file__).parent / "report" / "viewer"
SOURCES = ("viewer.js", "stage.js", "report.js", "live.js", "world.js", "body.js", "charts.js")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
QUIET = (
    "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--virtual-time-budget=1000", "--dump-dom",
)  # fmt: skip


def test_the_script_was_made_of_its_sources() -> None:
    text = b"".join((VIEWER / name).read_bytes() for name in SOURCES)
    made_of = (VIEWER / "viewer.sha256").read_text(encoding="ascii").strip()
    assert sha256(text).hexdigest() == made_of, "make viewer.min.js anew, as report/viewer/README.md says"
    assert "</script" not in (VIEWER / "viewer.min.js").read_text(encoding="utf-8")
    assert "MIT" in (VIEWER / "LICENSE.three.txt").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene, path = scene_sample(0.2, wearers=1), tmp_path_factory.mktemp("page") / "report.html"
    write_report(estimate_of(scene), path, scene)
    return path


@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the PATH")
@pytest.mark.parametrize("with_gl", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_page_works_in_a_browser(page: Path, with_gl: bool, tmp_path: Path) -> None:
    flags = SOFTWARE_GL if with_gl else ("--disable-gpu", "--disable-3d-apis")
    command = [str(BROWSER), *QUIET, *flags, f"--user-data-dir={tmp_path / 'profile'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    root, body = (re.search(f"<{tag}[^>]*>", done.stdout) for tag in ("html", "body"))
    assert root is not None, done.stderr[-2000:]
    assert body is not None
    assert "data-error" not in root[0]
    told = dict(re.findall(r'data-(\w+)="(\w+)"', body[0]))
    if with_gl and told.get("webgl") == "no":
        pytest.skip("this browser has no WebGL, not even in software")
    assert told == {"viewer": "ready", "webgl": "yes" if with_gl else "no", "frames": "7", "charts": told["charts"],
                    "bodies": "2"}  # fmt: skip
    assert int(told["charts"]) >= 12
    assert ("with-3d" in body[0]) == with_gl
    readouts = re.findall(r'class="readout">([^<]*)', done.stdout)
    assert any("left" in readout and "right" in readout for readout in readouts)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the PATH")
@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="no pdftotext (poppler-utils) on the PATH")
def test_the_page_prints(page: Path, tmp_path: Path) -> None:
    printed = tmp_path / "report.pdf"
    flags = (*QUIET[:-1], *SOFTWARE_GL, f"--user-data-dir={tmp_path / 'profile'}")
    subprocess.run([str(BROWSER), *flags, f"--print-to-pdf={printed}", page.as_uri()], timeout=300, check=True)
    text = subprocess.run(["pdftotext", str(printed), "-"], capture_output=True, text=True, check=True).stdout
    pages = text.split("\f")[:-1]
    assert 5 <= len(pages) <= 30
    assert all(page.strip() for page in pages)
    for heading in ("Summary", "Joint angles", "How well it fits", "What was found", "What was recorded"):
        assert heading in text
    assert "Drag to turn" not in text


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the PATH")
def test_the_film_and_the_page_show_one_time(tmp_path: Path) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs the extra dev")
    pytest.importorskip("av", reason="needs the extra film")
    scene, report = scene_sample(1.0), tmp_path / "report.html"
    write_report(
        estimate_of(scene), report, scene, video=True, video_height=96
    )  # fmt: skip
    flags = ["--no-sandbox", *SOFTWARE_GL]
    with playwright.sync_playwright() as tool, tool.chromium.launch(executable_path=BROWSER, args=flags) as browser:
        page = browser.new_page(color_scheme="dark")
        page.goto(report.as_uri())
        page.wait_for_selector("body[data-viewer=ready]", timeout=60_000)
        if not page.evaluate("document.createElement('video').canPlayType('video/mp4; codecs=\"avc1.640028\"')"):
            pytest.skip("this browser plays no H.264")

        def until(true: str) -> None:  # the page's own policy forbids Playwright's way to wait
            for _ in range(600):
                if page.evaluate(true):
                    return
                page.wait_for_timeout(50)
            raise AssertionError(true)

        until("film.readyState >= 2")
        page.evaluate("slider.value = 6; slider.dispatchEvent(new Event('input'))")  # of 30 a second
        until("Math.abs(film.currentTime - 0.2) < 0.01")
        page.evaluate("film.play()")
        until("clock.textContent > '0.5'")
        assert page.locator("html").get_attribute("data-error") is None
