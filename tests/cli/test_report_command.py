"""``vip-factors report``: the page appears beside the estimate, and what the user can mend is told in one line."""

from pathlib import Path

import pytest
from scene_sample import estimate_of, scene_sample

from vip_factors.cli.main import main
from vip_factors.io.mcap_estimate_writer import write_estimate
from vip_factors.io.mcap_recording import write_scene


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene, its estimate, and a file that holds both."""
    folder = tmp_path_factory.mktemp("report")
    scene = scene_sample(0.2)
    write_scene(scene, folder / "scene.mcap")
    write_estimate(estimate_of(scene), folder / "scene.estimate.mcap")
    write_estimate(estimate_of(scene), folder / "both.mcap", append_to=folder / "scene.mcap")
    return folder


def test_the_page_is_beside_the_estimate(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(files / "scene.estimate.mcap"), "--moments", "0"]) == 0
    page = files / "scene.estimate.html"
    assert capsys.readouterr().out == f"{page}\n"
    assert "Against the truth" not in page.read_text(encoding="utf-8")
    assert main(["report", str(files / "scene.estimate.mcap"), "--moments", "0"]) == 2
    assert "exists" in capsys.readouterr().err


def test_the_recording_is_named_or_in_the_same_file(files: Path, tmp_path: Path) -> None:
    named, together, truth = (tmp_path / f"{name}.html" for name in ("named", "together", "truth"))
    few = ["--moments", "0", "--out"]
    scene, estimate = str(files / "scene.mcap"), str(files / "scene.estimate.mcap")
    assert main(["report", estimate, "--recording", scene, *few, str(named)]) == 0
    assert main(["report", str(files / "both.mcap"), *few, str(together)]) == 0
    assert main(["report", estimate, "--truth", scene, *few, str(truth)]) == 0
    for page in (named, together, truth):
        assert "Against the truth" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["missing.mcap"], "missing.mcap"),
        (["scene.mcap"], "estimate"),
        (["scene.estimate.mcap", "--out", "page.pdf"], ".html"),
        (["scene.estimate.mcap", "--out", "page.html", "--moments", "-1"], "moments"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], told: str, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    assert main(["report", *words]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
    assert not (files / "page.html").exists()
