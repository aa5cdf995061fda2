"""The catalogue of faults: every fault changes what it is put into, causes are told from others, rows are kept."""

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.studies.catalogue import REFUSED, SOUND, Catalogue, CatalogueRow
from tests.studies.fault_table import FAULTS, Fault
from tests.studies.study import markdown, run
from vip_factors.findings import KINDS
from vip_factors.io.mcap_recording import write_recording
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.scene import Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings


@cache
def scene(seed: int = 0) -> Scene:
    motion = gestures(9.0)
    performer = Performer("anna", motion, preset("totalcapture13", motion.skeleton), "t-pose")
    return simulate_scene([performer], SceneSettings(camera="fixed"), seed, f"scene{seed}")


def row(fault: str, *kinds: str, degrees: float = 10.0, severity: str = "doubt") -> CatalogueRow:
    return CatalogueRow("walk", fault, degrees, 0.0, [(one, severity, f"{one} of 'LS'") for one in kinds], ["LS"])


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_fault_has_its_place_and_kinds_that_there_are(fault: Fault) -> None:
    faulty = fault.put(scene(), scene(1))
    assert faulty is not None
    changed, names = faulty
    assert changed is not scene()
    assert set(names) <= set(scene().wearers[0].placed)
    assert set(fault.kinds) <= set(KINDS)


def test_the_cause_has_to_be_among_the_first_two_and_to_name_the_sensor() -> None:
    assert row("thighs exchanged", "impossible posture", "sensors exchanged").is_told
    assert not row("thighs exchanged", "impossible posture", "unusual posture", "sensors exchanged").is_told
    assert not row("thighs exchanged", "impossible posture").is_told
    other = CatalogueRow("walk", "thighs exchanged", 9.0, 0.0, [("sensors exchanged", "doubt", "'RS'")], ["LS"])
    assert not other.is_told


def test_that_a_set_up_tells_no_more_is_no_false_warning() -> None:
    assert row(SOUND, "limited set-up", severity="care").is_limited
    assert not row(SOUND, "limited set-up", severity="care").warns
    assert row(SOUND, "limited set-up", "unusual posture", severity="care").warns


def test_rows_that_are_kept_are_not_made_again(tmp_path: Path) -> None:
    file, refused = tmp_path / "scene.mcap", row("stuck", REFUSED)
    write_recording(scene(), file)
    name = f"{scene().name}, {scene().camera.name}"  # type: ignore[union-attr]
    kept = [row(SOUND, degrees=np.nan), row("stuck", "sensor stuck"), row("clock 40 ms late", "unusual posture")]
    lines = [json.dumps(asdict(one) | {"recording": name}) + "\n" for one in kept]
    (tmp_path / "catalogue.jsonl").write_text("".join(lines))
    study = Catalogue(folder=tmp_path, scenes=(file,), faults=("stuck", "clock"))
    found = run(study)
    assert [one.fault for one in found] == [SOUND, "stuck", "clock 40 ms late"]
    text = markdown(study, found)
    assert "0 of 1 recordings without a fault" in text
    assert "clock 40 ms late, scene0, " in text
    assert not refused.is_told
