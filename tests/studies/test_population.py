"""The study of a population: who is in it, and that it goes on where it was interrupted."""

import json
import zlib
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from tests.studies.population import CHOOSING, COLUMNS, Population, PopulationRow, population
from tests.studies.study import markdown, run
from tests.studies.weights import RUNS, WEIGHTS, Weights, WeightsRow, design
from vip_factors.settings import Settings


def motions(folder: Path) -> Path:
    for clip, frames in (("02_01", 2400), ("05_01", 120), ("05_02", 240), ("07_03", 1200), ("08_01", 150)):
        file = folder / clip[:2] / f"{clip}.bvh"
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"MOTION\nFrames:\t{frames}\nFrame Time:\t0.0083333\n")
    return folder


def study(folder: Path) -> Population:
    return Population(simulator=folder / "none.py", motions=motions(folder), folder=folder, half="both")


def test_every_clip_is_drawn_and_no_performer_is_in_both_halves(tmp_path: Path) -> None:
    drawn = population(motions(tmp_path))
    assert {one.clips[0] for one in drawn} == {"02_01", "05_01", "05_02", "07_03", "08_01"}
    assert drawn == population(tmp_path)
    assert all(clip[:2] == one.clips[0][:2] for one in drawn for clip in one.clips)
    chosen = {one.clips[0][:2] for one in drawn if one.is_for_choosing}
    assert chosen == {"05", "07"} <= CHOOSING
    assert {len(one.clips) for one in drawn if one.clips[0] == "05_01"} == {2}  # short clips are played in twos


def test_rows_that_are_kept_are_not_made_again(tmp_path: Path) -> None:
    of, settings = study(tmp_path), replace(Settings(), frame_rate=60.0)
    rows = [PopulationRow(one.name, dict.fromkeys(COLUMNS, float(n))) for n, one in enumerate(of.scenes())]
    kept = tmp_path / f"rows_{zlib.crc32(repr(settings).encode()):08x}.jsonl"
    kept.write_text("".join(json.dumps(asdict(row)) + "\n" for row in rows))
    found = run(of)
    assert [row.scene for row in found] == [row.scene for row in rows]
    assert f"{np.median(range(5)):.1f}" in markdown(of, found)


def test_the_effects_of_weights_do_not_hide_behind_one_another() -> None:
    levels = design()
    assert levels.shape == (RUNS, len(WEIGHTS))
    np.testing.assert_allclose(levels.T @ levels, RUNS * np.eye(len(WEIGHTS)))


def test_an_effect_is_told_in_percent(tmp_path: Path) -> None:
    of = Weights(simulator=tmp_path, motions=tmp_path, folder=tmp_path)
    level = np.concatenate([[0.0], design()[:, list(WEIGHTS).index("orientation")]])
    rows = [WeightsRow(n, PopulationRow("one", dict.fromkeys(COLUMNS, 20 * 1.1**up))) for n, up in enumerate(level)]
    told = next(line for line in markdown(of, rows).splitlines() if "orientation" in line)
    assert "+9.5" in told  # the logarithm of 1.1
