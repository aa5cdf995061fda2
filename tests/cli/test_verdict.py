"""The verdict on an estimate is one: in the terminal, the report, JSON and the exit code."""

import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from scene_sample import estimate_of, scene_sample

from vip_factors.findings import Finding
from vip_factors.io.live_json import LiveJsonSink
from vip_factors.io.mcap_estimate import read_estimate, write_estimate
from vip_factors.io.mcap_recording import write_recording
from vip_factors.solve.levenberg_marquardt import SolveReport

NOTE, CARE = Finding("apart"), Finding("video unused", words={"reason": "no wearer was found in it"})
DOUBT = Finding("sensor stuck", "ann", subject="LS", numbers={"seconds": 4.0})
SCENE = scene_sample(0.2, wearers=1)


@pytest.mark.parametrize(
    ("findings", "word", "limit", "code"),
    [
        ((NOTE,), "good", "care", 0),
        ((NOTE, CARE), "care", "care", 3),
        ((CARE,), "care", "doubt", 0),
        ((CARE, DOUBT), "doubt", "doubt", 3),
    ],
)
def test_everything_tells_the_same(run: Callable, tmp_path: Path, findings, word: str, limit: str, code: int) -> None:
    """Terminal, page, JSON, code of ``--fail-on``."""
    estimate, scene, made = estimate_of(SCENE), tmp_path / "scene.mcap", tmp_path / "e.mcap"
    write_recording(SCENE, scene)
    write_estimate(replace(estimate, findings=findings), made)
    told = re.search(r"verdict: +(\w+), (.*)", run("info", made).out)
    assert told[1].lower() == word
    page, table = tmp_path / "e.html", tmp_path / "e.json"
    assert run("report", made, "--fail-on", limit).code == code
    weights = re.findall(r'<li class="(\w+)">', page.read_text())
    assert weights[0] == word
    assert "good" not in weights[1:]
    assert run("evaluate", made, "--truth", scene, "--json", table).code == 0
    assert json.loads(table.read_text())["verdict"] == word


def test_what_smooth_prints_is_in_the_file_which_is_written_whatever_the_verdict(
    run: Callable, files, tmp_path: Path
) -> None:
    few = ("--frame-rate", 20, "--solve.max-iterations", 1)
    told = run("smooth", files.recording, "--out", tmp_path / "e.mcap", *few, "--fail-on", "care")
    assert told.code == 3
    verdicts = [re.search("verdict: +(.*)", text)[1] for text in (told.out, run("info", tmp_path / "e.mcap").out)]
    assert verdicts == [str(read_estimate(tmp_path / "e.mcap").verdict)] * 2
    assert "computation stopped early" in verdicts[0]


def test_only_the_last_solve_has_to_settle() -> None:
    estimate = estimate_of(SCENE)
    first, last = (SolveReport(stage, (), {}, {}, stage == "last", 0.0) for stage in ("first", "last, window 2"))
    kinds = [
        [finding.kind for finding in replace(estimate, reports=reports).all_findings]
        for reports in ((first, replace(last, converged=True)), (replace(first, converged=True), last))
    ]
    assert kinds == [[], ["not converged"]]


def test_of_a_stream_it_is_the_worst_so_far() -> None:
    lines = io.StringIO()
    sink = LiveJsonSink(lines, SimpleNamespace(wearers=()))
    for found in ((CARE,), (), (DOUBT,), (NOTE,)):
        sink.write(SimpleNamespace(frame=0, time=0.0, wearers=(), cameras=(), findings=found,
                                   preliminary=False, seconds=0.0))  # fmt: skip
    verdicts = [json.loads(line)["verdict"] for line in lines.getvalue().splitlines()]
    assert verdicts == ["care", "care", "doubt", "doubt"]
