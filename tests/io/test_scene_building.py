"""Recordings, 2D poses, camera and video become one scene; what does not belong together is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from films import write_video
from mcap_samples import assert_same, walk
from pose_files import person, write_coco, write_openpose
from scene_samples import filmed_walk

from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import rotation_z
from vip_factors.io.scene_building import SceneWarning, add_cameras, join_wearers
from vip_factors.io.settings import CameraOptions
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

CAMERA = "width = {0}\nheight = {1}\nfx = 500\nfy = 500\ncx = 320\ncy = 240\n"


def add_camera(scene: Scene, options: CameraOptions) -> Scene:
    return add_cameras(scene, [options])


def of(name: str, **changes: object) -> Recording:
    one = walk(200, 10)
    return replace(one, name=f"walk of {name}", subject=replace(one.subject, name=name), **changes)  # type: ignore[arg-type]


@pytest.fixture
def given(tmp_path: Path) -> CameraOptions:
    (tmp_path / "camera.toml").write_text(CAMERA.format(640, 480))
    poses = write_coco(tmp_path / "poses.json", {frame: [person()] for frame in range(20)})
    return CameraOptions(poses, tmp_path / "camera.toml", video_rate=10.0)


def test_the_camera_s_sensor_leaves_its_wearer(given: CameraOptions) -> None:
    R = rotation_z(0.3)
    scene = add_camera(
        Scene("s", (of("Ada"),)),
        replace(given, camera_imu="head", camera_imu_wxyz=tuple(quaternion_from_matrix(R, Order.WXYZ))),
    )
    assert scene.camera is not None
    assert scene.camera.mount is not None
    assert scene.camera.mount.imu.name == "head"
    np.testing.assert_allclose(scene.camera.mount.R_camera_imu, R, atol=1e-12)
    assert scene.camera.mount.is_declared
    assert "head" not in scene.wearers[0].imus
    assert "head" not in [site.sensor for site in scene.wearers[0].placement.sites]
    with pytest.raises(InputError, match=r"no wearer's recording has a sensor 'phone'.*pelvis"):
        add_camera(Scene("s", (of("Ada"),)), replace(given, camera_imu="phone"))
    with pytest.raises(InputError, match="several recordings have a sensor 'head'"):
        add_camera(Scene("s", (of("Ada"), of("Bea"))), replace(given, camera_imu="head"))


def test_the_camera_s_sensor_may_have_a_log_of_its_own(given: CameraOptions, tmp_path: Path) -> None:
    rows = ["t,ax,ay,az,gx,gy,gz", *(f"{100 + i / 50},0,0,9.81,0,0,0.1" for i in range(200))]
    (tmp_path / "phone.csv").write_text("\n".join(rows) + "\n")
    columns = tmp_path / "columns.toml"
    columns.write_text('time = "t"\nacceleration = ["ax", "ay", "az"]\nangular_rate = ["gx", "gy", "gz"]\n')
    told = replace(given, camera_imu_log=tmp_path / "phone.csv", camera_imu_columns=columns, camera_imu_offset_s=0.5)
    scene = add_camera(Scene("s", (of("Ada"),)), told)
    assert scene.camera is not None
    assert scene.camera.mount is not None
    stream = scene.camera.mount.imu
    assert not scene.camera.mount.is_declared  # nobody said how it sits
    assert (stream.name, len(stream), stream.time[0]) == ("phone", 200, 0.5)
    assert stream.R_inertial_sensor is not None
    assert scene.wearers[0].imus.keys() == of("Ada").imus.keys()
    with pytest.warns(SceneWarning, match="no absolute time in common"):
        add_camera(Scene("s", (of("Ada"),)), replace(told, camera_imu_offset_s=None))
    with pytest.raises(InputError, match="has no sensor 'fone'; did you mean 'phone'"):
        add_camera(Scene("s", (of("Ada"),)), replace(told, camera_imu="fone"))
    columns.write_text(columns.read_text() + "[sensors.a]\n[sensors.b]\n")
    with pytest.raises(InputError, match="has the sensors a, b: name the one"):
        add_camera(Scene("s", (of("Ada"),)), told)


def test_a_known_pose_is_that_of_the_camera_file(given: CameraOptions) -> None:
    scene = Scene("s", (of("Ada"),))
    with pytest.raises(InputError, match=r"camera\.toml: its pose cannot be taken as known: the file has no pose"):
        add_camera(scene, replace(given, static_camera=True, known_camera_pose=True))
    floor = "[floor]\nR_floor_camera = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]\np_floor_camera = [0, 0, 1.5]\n"
    given.camera.write_text(CAMERA.format(640, 480) + floor)
    with pytest.raises(InputError, match="not declared to stand still"):
        add_camera(scene, replace(given, known_camera_pose=True))
    camera = add_camera(scene, replace(given, static_camera=True, known_camera_pose=True)).camera
    assert camera is not None
    assert camera.known_path is not None
    np.testing.assert_allclose(camera.known_path.p_world_camera, [[0, 0, 1.5]])


def greys(frames: int) -> list[np.ndarray]:
    return [np.full((480, 640, 3), 5 * index, np.uint8) for index in range(frames)]


def test_times_are_those_of_the_video(given: CameraOptions, tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.mp4", greys(24), 8.0)
    with pytest.warns(SceneWarning, match="8.00 frames a second, not 10"):
        camera = add_camera(Scene("s", (of("Ada"),)), replace(given, video=video, embed_video=True)).camera
    assert camera is not None
    np.testing.assert_allclose(camera.detections.time, np.arange(24) / 8, atol=1e-3)
    assert camera.video is not None
    assert sorted(camera.video.images) == list(range(0, 24, 3))


def test_what_does_not_belong_together_is_refused(given: CameraOptions, tmp_path: Path) -> None:
    scene = Scene("s", (of("Ada"),))
    with pytest.raises(InputError, match="without times: give the video's rate"):
        add_camera(scene, replace(given, video_rate=None))
    with pytest.raises(InputError, match=r"v\.mp4 has 12 frames, but the detections have 20"):
        add_camera(scene, replace(given, video=write_video(tmp_path / "v.mp4", greys(12), 8.0)))
    given.camera.write_text(CAMERA.format(320, 240))
    with pytest.raises(InputError, match=r"poses\.json: \d+ % of the points.*320 by 240.*camera\.toml.*resolution"):
        add_camera(scene, given)
    with pytest.raises(InputError, match="640 by 480 pixels, but the camera was calibrated at 320 by 240"):
        add_camera(scene, replace(given, video=write_video(tmp_path / "w.mp4", greys(20), 8.0)))
    given.camera.write_text(CAMERA.format(1920, 1440))
    with pytest.warns(SceneWarning, match="if the detector saw a smaller image"):
        add_camera(scene, given)
    given.camera.write_text(CAMERA.format(640, 480))
    with pytest.warns(SceneWarning, match=r"ends at frame 20 of the 40 in .*if the detector left frames out"):
        add_camera(scene, replace(given, video_rate=None, video=write_video(tmp_path / "x.mp4", greys(40), 8.0)))
    nobody = write_openpose(tmp_path / "nobody", {frame: [] for frame in range(7)})
    with pytest.raises(InputError, match="in none of 7 video frames is anybody"):
        add_camera(scene, replace(given, detections=nobody))


def test_clocks_without_common_time_are_told(given: CameraOptions) -> None:
    with pytest.warns(SceneWarning, match="little in common; vip-factors sync"):
        add_camera(Scene("s", (of("Ada"),)), replace(given, time_offset_s=100.0))


def test_wearers_are_joined_on_the_clock_of_the_first() -> None:
    ada, bea = of("Ada"), of("Bea")
    later = replace(bea, start_ns=ada.start_ns + 2_500_000_000)
    scene = join_wearers([Scene("a", (ada,)), Scene("b", (later,))], "both")
    assert scene.name == "both"
    assert_same(ada, scene.wearers[0])
    joined = scene.wearers[1]
    assert joined.start_ns == ada.start_ns
    np.testing.assert_allclose(joined.imus["head"].time, bea.imus["head"].time + 2.5)
    assert joined.truth is not None
    assert bea.truth is not None
    assert joined.truth.motion.start == pytest.approx(bea.truth.motion.start + 2.5)
    with pytest.warns(SceneWarning, match="no absolute time in common"):
        scene = join_wearers([Scene("a", (ada,)), Scene("b", (replace(bea, start_ns=0),))])
    np.testing.assert_array_equal(scene.wearers[1].imus["head"].time, bea.imus["head"].time)


def test_joining_refuses_two_cameras_and_two_of_a_name() -> None:
    filmed = filmed_walk(5)
    with pytest.raises(InputError, match="two wearers are called 'Ada'"):
        join_wearers([filmed, Scene("b", (of("Ada"),))])
    other = replace(filmed, wearers=(of("Bea"),))
    with pytest.raises(InputError, match="'filmed', 'filmed' have a camera each"):
        join_wearers([filmed, other])
    assert join_wearers([Scene("a", (of("Cleo"),)), filmed]).camera is not None
