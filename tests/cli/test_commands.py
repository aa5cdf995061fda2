import json
from pathlib import Path

import numpy as np
import pytest

from vip_factors.cli.main import COMMANDS
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import read_recording


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command(run, command: str) -> None:
    told = run(command, "--help")
    assert told.code == 0
    assert f"usage: vip-factors {command}" in told.out
    assert command in run("--help").out


def test_version_and_nothing(run) -> None:
    assert run("--version").out.startswith("vip-factors ")
    assert run().code == 2


def test_simulated_recording_is_what_was_asked_for(files) -> None:
    recording = read_recording(files.recording)
    assert set(recording.imus) == set(recording.placed)
    assert len(recording.imus) == 6
    assert recording.initial_pose == "n-pose"
    assert recording.truth is not None


def test_smooth_writes_beside_the_recording_with_its_settings(files) -> None:
    estimate = read_estimate(files.estimate)
    assert estimate.motion.rate == pytest.approx(20.0)
    assert estimate.settings["solve.max_iterations"] == "3"
    assert set(estimate.calibration) == set(estimate.sensors)


def test_info_tells_sensors_and_solves(run, files) -> None:
    told = run("info", files.recording)
    assert "left_forearm" in told.out
    assert "truth: motion and calibration" in told.out
    told = run("info", files.estimate)
    assert "sparse inertial poser: " in told.out
    assert "heading of pelvis" in told.out


def test_evaluate_prints_a_table_and_writes_json(run, files, tmp_path: Path) -> None:
    told = run("evaluate", files.estimate, "--truth", files.recording, "--json", tmp_path / "e.json")
    assert told.code == 0
    assert "| mpjpe |" in told.out
    written = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    assert np.isfinite(written["metrics"]["mpjpe"]["value"])


def test_view_writes_what_is_asked(run, files, tmp_path: Path) -> None:
    told = run(
        "view", files.recording, files.estimate, "--save", tmp_path / "a.rrd", "--picture", tmp_path / "a.png",
        "--compare", "side",
    )  # fmt: skip
    assert told.code == 0, told.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "a.rrd"]
    assert run("view", files.recording, "--save", tmp_path / "b.rrd").code == 0


def test_settings_file_and_options_over_it(run, files, tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("frame_rate = 10\nacceleration = false\n[solve]\nmax_iterations = 2\n", encoding="utf-8")
    told = run(
        "smooth", files.recording, "--out", tmp_path / "e.mcap", "--settings", settings, "--solve.max-iterations", "1"
    )
    assert told.code == 0, told.err
    estimate = read_estimate(tmp_path / "e.mcap")
    assert estimate.method == "SOP"
    assert estimate.motion.rate == pytest.approx(10.0)
    assert estimate.settings["solve.max_iterations"] == "1"


def test_demo_makes_everything(run, tmp_path: Path) -> None:
    told = run("demo", "--out", tmp_path / "demo", "--seconds", "1.5", "--placement", "sip6", "--frame-rate", "20")
    assert told.code == 0, told.err
    made = sorted(path.name for path in (tmp_path / "demo").iterdir())
    assert made == ["demo.png", "demo.rrd", "estimate.mcap", "evaluation.json", "recording.mcap"]
    for name in made:
        assert name in told.out
    again = run("demo", "--out", tmp_path / "demo")
    assert again.code == 2
    assert "exists" in again.err


def test_train_prior_from_a_folder_of_motions(run, files, tmp_path: Path) -> None:
    from vip_factors.body.pose_prior import load_pose_prior

    _write_bvh(tmp_path / "motions" / "01_01.bvh")
    told = run("train", "prior", "--motions", tmp_path / "motions", "--out", tmp_path / "p.npz", "--rate", "100")
    assert told.code == 0, told.err
    assert load_pose_prior(tmp_path / "p.npz").mean.shape == (69,)
    assert "pose prior" not in told.err


def _write_bvh(path: Path) -> None:
    """A stick figure with the common joint names that waves, as BVH."""
    path.parent.mkdir()
    limbs = {
        "LeftUpLeg": "LeftUpLeg 9 0 0 LeftLeg 0 -42 0 LeftFoot 0 -42 0 LeftToeBase 0 -6 13",
        "RightUpLeg": "RightUpLeg -9 0 0 RightLeg 0 -42 0 RightFoot 0 -42 0 RightToeBase 0 -6 13",
        "Spine": "Spine 0 12 0 Spine1 0 16 0",
    }
    upper = [
        "Neck 0 20 0 Head 0 8 0",
        "LeftShoulder 4 14 0 LeftArm 12 0 0 LeftForeArm 28 0 0 LeftHand 25 0 0",
        "RightShoulder -4 14 0 RightArm -12 0 0 RightForeArm -28 0 0 RightHand -25 0 0",
    ]
    count = 1

    def chain(text: str, inner: str = "") -> str:
        nonlocal count
        words = text.split()
        joints = [words[at : at + 4] for at in range(0, len(words), 4)]
        body = inner or "End Site\n{\nOFFSET 0 5 0\n}\n"
        for name, *offset in reversed(joints):
            count += 1
            body = f"JOINT {name}\n{{\nOFFSET {' '.join(offset)}\nCHANNELS 3 Zrotation Yrotation Xrotation\n{body}}}\n"
        return body

    trunk = chain(limbs["Spine"], "".join(chain(text) for text in upper))
    legs = chain(limbs["LeftUpLeg"]) + chain(limbs["RightUpLeg"])
    channels = "CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation"
    head = f"HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\n{channels}\n{trunk}{legs}}}\nMOTION\n"
    rng = np.random.default_rng(3)
    frames = np.hstack([np.tile([0.0, 90.0, 0.0], (120, 1)), rng.uniform(-20, 20, (120, 3 * count))])
    rows = "\n".join(" ".join(f"{value:.3f}" for value in row) for row in frames)
    path.write_text(f"{head}Frames: 120\nFrame Time: 0.01\n{rows}\n", encoding="utf-8")
