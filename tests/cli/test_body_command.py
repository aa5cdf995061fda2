"""A body that was found goes into a file, and the next recording of the same person starts from it."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vip_factors.cli.main import main
from vip_factors.io.body_file import read_body_file
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.sensors.recording import Subject

Run = Callable[..., Any]
QUICK = ["--frame-rate", "10", "--no-covariance", "--fusion.rounds", "1", "--fusion.refits", "0"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A filmed wearer of whom only the stature is told, and the estimate."""
    folder = tmp_path_factory.mktemp("body")
    made = [str(folder / name) for name in ("scene.mcap", "e.mcap")]
    assert main(["simulate", "gestures", made[0], "--camera", "fixed", "--seconds", "3", "--placement", "sip6"]) == 0
    scene = read_scene(made[0])
    wearers = tuple(replace(wearer, subject=Subject("Ada", 1.72)) for wearer in scene.wearers)
    write_recording(replace(scene, wearers=wearers), made[0], overwrite=True)
    assert main(["smooth", made[0], "--out", made[1], *QUICK]) == 0
    return folder


def test_info_tells_lengths_before_and_after(run: Run, folder: Path) -> None:
    told = run("info", folder / "e.mcap")
    assert told.code == 0, told.err
    for words in ("length, mm", "likely before", "thigh", "keeps what was likely", "carrying angle", "left elbow", "°"):
        assert words in told.out


def test_from_an_estimate_to_the_next_recording(run: Run, folder: Path, tmp_path: Path) -> None:
    told = run("body", folder / "e.mcap", "--out", tmp_path / "ada.toml")
    assert told.code == 0, told.err
    assert told.out.endswith("ada.toml\n")
    found, body = read_estimate(folder / "e.mcap").wearer(), read_body_file(tmp_path / "ada.toml")
    assert body.name == "Ada"
    np.testing.assert_array_equal(body.skeleton.p_parent_joint, found.motion.skeleton.p_parent_joint)
    told = run("convert", folder / "scene.mcap", tmp_path / "again.mcap", "--body", tmp_path / "ada.toml")
    assert told.code == 0, told.err
    [wearer] = read_scene(tmp_path / "again.mcap").wearers
    assert wearer.subject.length_prior is not None
    assert [hinge.joint for hinge in wearer.subject.hinges] == ["left_elbow", "right_elbow", "left_knee", "right_knee"]
    assert wearer.subject.body().source.startswith("e.mcap, VIP")
    told = run("smooth", tmp_path / "again.mcap", "--out", tmp_path / "again.e.mcap", *QUICK)
    assert told.code == 0, told.err
    again = read_estimate(tmp_path / "again.e.mcap").wearer().body
    assert again is not None
    assert found.body is not None
    np.testing.assert_allclose(again.prior, found.body.posterior, atol=1e-6)
    for before, after in zip(found.body.hinges, again.prior_hinges, strict=True):
        np.testing.assert_allclose(after.variables, before.variables, atol=1e-5)
    told = run("evaluate", tmp_path / "again.e.mcap", "--truth", folder / "scene.mcap", "--json", tmp_path / "e.json")
    assert told.code == 0, told.err
    assert "length_error" in (tmp_path / "e.json").read_text()


def test_a_stream_uses_the_body(run: Run, folder: Path, tmp_path: Path) -> None:
    assert run("body", folder / "e.mcap", "--out", tmp_path / "ada.toml").code == 0
    assert run("convert", folder / "scene.mcap", tmp_path / "a.mcap", "--body", tmp_path / "ada.toml").code == 0
    options = ("--out", tmp_path / "live.mcap", "--frame-rate", "10", "--recalibration.no-use")
    told = run("stream", tmp_path / "a.mcap", *options)
    assert told.code == 0, told.err
    skeleton = read_estimate(tmp_path / "live.mcap").wearer().motion.skeleton
    np.testing.assert_array_equal(
        skeleton.p_parent_joint, read_body_file(tmp_path / "ada.toml").skeleton.p_parent_joint
    )


def test_a_foreign_log_takes_a_body(run: Run, folder: Path, tmp_path: Path) -> None:
    table = "DataRate=100.0\nDataType=Quaternion\nversion=3\nOpenSimVersion=4.2\nendheader\ntime\tpelvis_imu\n"
    rows = "".join(f"{0.01 * row:.2f}\t1.0,0.0,0.0,0.0\n" for row in range(50))
    (tmp_path / "log.sto").write_text(table + rows)
    (tmp_path / "p.toml").write_text('stature_m = 1.9\n[sensors]\npelvis_imu = "pelvis"\n')
    assert run("body", folder / "e.mcap", "--out", tmp_path / "ada.toml").code == 0
    known = ("convert", tmp_path / "log.sto", tmp_path / "r.mcap", "--placement", tmp_path / "p.toml")
    told = run(*known, "--body", tmp_path / "ada.toml")
    assert told.code == 0, told.err
    assert re.search("subject: +Ada, e.mcap, VIP", told.out)
    assert "body of 'Ada'" in told.out
    told = run(*known, "--overwrite", "--body", tmp_path / "ada.toml", "--stature-m", "1.8")
    assert told.code == 2
    assert "stature_m given beside the body file" in told.err


def test_what_does_not_fit_is_one_sentence(run: Run, files: Any, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('name = "Ada"\n')
    for words, arguments in {
        "no body of 'subject' was looked for": ("body", files.estimate, "--out", tmp_path / "b.toml"),
        "expected 'Adda'": ("body", folder / "e.mcap", "--wearer", "Adda"),
        "bad.toml: skeleton is missing": (
            "convert", folder / "scene.mcap", tmp_path / "r.mcap", "--body", tmp_path / "bad.toml",
        ),
    }.items():  # fmt: skip
        told = run(*arguments)
        assert told.code == 2, words
        assert words in told.err
        assert told.err.count("\n") == 1
    assert not (tmp_path / "r.mcap").exists()
