"""``vip-factors gait``: tables, JSON and a picture from an estimate, or from a recording."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from simulated_walk import STRIDE_M, walk

from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.mcap_estimate import write_estimate
from vip_factors.io.mcap_recording import write_recording
from vip_factors.sensors.calibration import preset
from vip_factors.simulate.recording import simulate_recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a walk, its estimate, and an estimate of somebody who stands."""
    folder, motion = tmp_path_factory.mktemp("gait"), walk(5.0)
    recording = simulate_recording(motion, preset("sip6", motion.skeleton), seed=1)
    write_recording(recording, folder / "walk.mcap")
    walker = WearerEstimate("walk", "SIP", motion, {}, sensors=tuple(recording.placed))
    write_estimate(Estimate.of_one(walker), folder / "walk.estimate.mcap")
    still = WearerEstimate("still", "SIP", motion.frames(slice(0, 20)), {})
    write_estimate(Estimate.of_one(still), folder / "still.mcap")
    return folder


def test_tables_of_an_estimate(run: Callable, folder: Path, tmp_path: Path) -> None:
    words = ("gait", folder / "walk.estimate.mcap", "--recording", folder / "walk.mcap", "-o", tmp_path / "out")
    told = run(*words)
    assert told.code == 0
    assert "events by the motion of the legs" in told.out
    assert "speed: 1.1" in told.out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "strides.csv", "figures.csv", "curves.csv", "gait.json", "gait.png",
    }  # fmt: skip
    assert run(*words).code == 2
    assert run(*words, "--overwrite").code == 0


def test_a_step_that_stops_a_walk_is_in_no_mean_unless_asked(run: Callable, tmp_path: Path) -> None:
    motion = walk(5.5, stop_at=4.0)
    estimate = tmp_path / "walk.estimate.mcap"
    write_estimate(Estimate.of_one(WearerEstimate("walk", "SIP", motion, {})), estimate)
    lengths = {}
    for words in ((), ("--count", "stop")):
        told = run("gait", estimate, "--overwrite", *words)
        assert told.code == 0
        assert "verdict of the estimate: " in told.out
        assert ("left out: 1 stop" in told.out) == (not words)
        held = json.loads((tmp_path / "walk.estimate.gait" / "gait.json").read_text())
        assert held["verdict"].startswith("GOOD")
        (lengths[words],) = (
            (one["mean"], one["variability"]) for one in held["figures"]
            if (one["quantity"], one["side"]) == ("length", "both")
        )  # fmt: skip
        with (tmp_path / "walk.estimate.gait" / "figures.csv").open() as file:
            assert {row["verdict"] for row in csv.DictReader(file)} == {held["verdict"]}
    (steady, spread), (all_strides, wide) = lengths.values()
    assert steady == pytest.approx(STRIDE_M, rel=0.03)
    assert spread < 0.05 < wide
    assert all_strides < 0.97 * STRIDE_M


def test_a_side_with_few_strides_shows_them(run: Callable, tmp_path: Path) -> None:
    estimate = tmp_path / "short.estimate.mcap"
    write_estimate(Estimate.of_one(WearerEstimate("short", "SIP", walk(3.2), {})), estimate)
    assert run("gait", estimate).code == 0
    with (tmp_path / "short.estimate.gait" / "figures.csv").open() as file:
        rows = {row["side"]: row for row in csv.DictReader(file) if row["quantity"] == "length"}
    for side in ("left", "right"):
        assert 1 <= int(rows[side]["strides"]) <= 2
        assert float(rows[side]["mean"]) == pytest.approx(STRIDE_M, rel=0.05)


def test_a_recording_is_reconstructed_first(run: Callable, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    smoothed = []

    def smooth(scene, settings=None, progress=None) -> Estimate:
        smoothed.append(scene.name)
        return Estimate.of_one(WearerEstimate("walk", "SIP", walk(5.0), {}))

    monkeypatch.setattr("vip_factors.pipeline.smooth", smooth)
    assert run("gait", folder / "walk.mcap").code == 0
    assert len(smoothed) == 1
    assert (folder / "walk.gait" / "strides.csv").exists()


def test_nobody_walks(run: Callable, folder: Path, tmp_path: Path) -> None:
    told = run("gait", folder / "still.mcap", "--out", tmp_path / "out")
    assert told.code == 2
    assert "no walking" in told.err
    assert not (tmp_path / "out").exists()
