from dataclasses import replace
from pathlib import Path

import pytest
from rerun_files import printed

from vip_factors.errors import InputError
from vip_factors.viz.drawn_scene import Compare, drawn_wearer
from vip_factors.viz.rerun_view import show


def test_rerun_reads_back_body_sensors_plots_and_text(scene, tmp_path: Path) -> None:
    rrd = tmp_path / "scene.rrd"
    show(drawn_wearer(scene.recording, scene.estimate, scene.truth), rrd)
    chunks = printed(rrd)
    for entity in (
        "/world/ann/estimate/left_knee",
        "/world/ann/estimate/left_knee/left_shank",
        "/world/ann/truth/left_knee",
        "/plots/joint_error_mm/ann",
        "/plots/residual/orientation_deg",
        "/summary",
    ):
        assert f"{entity} " in chunks or f"{entity}`" in chunks or f"{entity}:" in chunks, entity
    assert "VisualBounds" in chunks or "blueprint" in chunks.lower()
    assert [path.name for path in tmp_path.iterdir()] == ["scene.rrd"]


@pytest.mark.parametrize("compare", Compare)
def test_every_way_to_compare_can_be_written(scene, tmp_path: Path, compare: Compare) -> None:
    show(drawn_wearer(None, scene.estimate, scene.truth, compare), tmp_path / "a.rrd")
    assert "/truth/pelvis" in printed(tmp_path / "a.rrd")


def test_a_bare_recording_stands_in_the_t_pose(scene, tmp_path: Path) -> None:
    show(drawn_wearer(replace(scene.recording, truth=None), None), tmp_path / "a.rrd")
    chunks = printed(tmp_path / "a.rrd")
    assert "/world/ann/body/head/head" in chunks
    assert "/estimate" not in chunks


def test_an_existing_file_is_kept(scene, tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    path.write_text("precious")
    with pytest.raises(InputError, match="exists"):
        show(drawn_wearer(None, scene.estimate), path)
    assert path.read_text() == "precious"
    show(drawn_wearer(None, scene.estimate), path, overwrite=True)
    assert path.stat().st_size > 100


def test_a_failure_leaves_nothing_behind(scene, tmp_path: Path) -> None:
    elsewhere = replace(scene.truth, start=1000.0)
    with pytest.raises(InputError, match="share no frame"):
        show(drawn_wearer(None, scene.estimate, elsewhere), tmp_path / "a.rrd")
    with pytest.raises(InputError, match="nothing to show"):
        show(drawn_wearer(None, None), tmp_path / "a.rrd")
    with pytest.raises(InputError, match="no folder"):
        show(drawn_wearer(None, scene.estimate), tmp_path / "missing" / "a.rrd")
    assert list(tmp_path.iterdir()) == []
