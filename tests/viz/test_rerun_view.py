"""Wearers and scenes in Rerun: what is drawn can be read back from the file."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from films import write_video
from rerun_files import printed
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene, Video
from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer
from vip_factors.viz.rerun_view import show


@pytest.fixture(scope="module")
def sample() -> Scene:
    return scene_sample(0.5)


@pytest.fixture(scope="module")
def found(sample: Scene) -> Estimate:
    return estimate_of(sample, Injected(yaw=0.8, shift=(1.0, 0.0, 0.2), heading=0.2, camera_m=0.05))


def entities(scene: Scene | None, estimate: Estimate | None, rrd: Path) -> set[str]:
    """The entities of the file, as Rerun's own command line reads them back."""
    show(drawn_scene(scene, estimate), rrd, overwrite=True)
    return set(re.findall(r"/(?:world|camera|plots|summary)[^\s`:,]*", printed(rrd)))


def test_camera_people_labels_and_curves_are_there(sample: Scene, found: Estimate, tmp_path: Path) -> None:
    there = entities(sample, found, tmp_path / "a.rrd")
    for entity in (
        "/world/camera", "/world/camera/image", "/world/camera_path", "/world/true_camera/image",
        "/world/ann/estimate/left_knee", "/world/bob/truth/left_knee", "/world/bob/estimate/head/name",
        "/world/camera/image/body/ann/limbs", "/world/camera/image/detected/ann/points",
        "/plots/reprojection_px/ann", "/plots/joint_error_mm/bob", "/summary",
    ):  # fmt: skip
        assert entity in there, entity
    assert any("nobody" in entity for entity in there)


def test_further_cameras_have_frusta_and_images(sample: Scene, found: Estimate, tmp_path: Path) -> None:
    standing = scene_sample(0.5, moving=False)
    second = replace(standing.camera, name="left", known_path=standing.camera.truth.path, mount=None)
    labelled = replace(found.camera, name="left")
    there = entities(
        replace(sample, cameras=(sample.camera, second)),
        replace(found, cameras=(found.camera, labelled)),
        tmp_path / "a.rrd",
    )
    for entity in ("phone", "phone/image/detected/ann/points", "left", "left/image", "left/image/body/ann/limbs"):
        assert f"/world/cameras/{entity}" in there, entity
    assert "/world/cameras/left/image/detected/ann/points" in there
    assert {f"/plots/reprojection_px/{camera}/ann" for camera in ("phone", "left")} <= there


def test_every_part_may_be_missing(sample: Scene, found: Estimate, tmp_path: Path) -> None:
    rrd = tmp_path / "a.rrd"
    alone = entities(None, found, rrd)
    assert "/world/camera" in alone
    assert not any("detected" in entity for entity in alone)
    true = entities(sample, None, rrd)
    assert "/world/ann/truth/pelvis" in true
    assert "/world/camera/image/detected/ann/points" in true  # the true labels colour them
    blind = replace(sample, cameras=())
    inertial = entities(blind, replace(found, cameras=()), rrd)
    assert "/world/ann/estimate/pelvis" in inertial
    assert "/world/camera" not in inertial
    nameless = replace(
        sample,
        cameras=(replace(sample.camera, truth=None),),
        wearers=tuple(replace(one, truth=None) for one in sample.wearers),
    )
    unknown = entities(nameless, None, rrd)
    assert not any(entity.startswith("/world/ann/") for entity in unknown)
    assert any("nobody" in entity for entity in unknown)


def test_nothing_to_show_is_said(sample: Scene, found: Estimate, tmp_path: Path) -> None:
    empty = replace(sample, cameras=(), wearers=(replace(sample.wearers[0], truth=None),))
    with pytest.raises(InputError, match="nothing to show"):
        show(drawn_scene(empty, None), tmp_path / "a.rrd")
    with pytest.raises(InputError, match="nothing to show"):
        show(drawn_scene(None, None), tmp_path / "a.rrd")
    with pytest.raises(InputError, match="1 wearers for a scene of 2"):
        show(drawn_scene(sample, replace(found, wearers=found.wearers[:1])), tmp_path / "a.rrd")
    assert not list(tmp_path.iterdir())


def test_pictures_come_from_images_or_a_video_file(sample: Scene, tmp_path: Path) -> None:
    grey = np.full((72, 128, 3), 120, np.uint8)
    blob = cv2.imencode(".jpg", grey)[1].tobytes()
    embedded = replace(sample.camera, video=Video(None, {0: blob, 3: blob, 999: blob}))
    show(drawn_scene(replace(sample, cameras=(embedded,)), None), tmp_path / "images.rrd")
    filed = replace(sample.camera, video=Video(write_video(tmp_path / "v.avi", [grey] * 5)))
    show(drawn_scene(replace(sample, cameras=(filed,)), None), tmp_path / "file.rrd")
    gone = replace(sample.camera, video=Video(tmp_path / "gone.mp4"))
    show(drawn_scene(replace(sample, cameras=(gone,)), None), tmp_path / "gone.rrd")
    pictures = {}
    for name in ("gone.rrd", "images.rrd", "file.rrd"):
        pictures[name] = printed(tmp_path / name, "-vv").count("EncodedImage:blob")
    assert pictures["gone.rrd"] == 0
    assert min(pictures["images.rrd"], pictures["file.rrd"]) > 0


def test_a_camera_without_frames_is_nothing_to_show(sample: Scene, tmp_path: Path) -> None:
    seen = sample.camera.detections
    none = Detections(seen.keypoints, np.zeros(0), np.zeros(0, int), seen.pixels[:0], seen.confidence[:0])
    wearers = tuple(replace(one, truth=None) for one in sample.wearers)
    blind = replace(sample, wearers=wearers, cameras=(replace(sample.camera, detections=none, truth=None),))
    with pytest.raises(InputError, match="nothing to show"):
        show(drawn_scene(blind, None), tmp_path / "a.rrd")


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
