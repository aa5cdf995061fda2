"""Small random scenes and their estimates for the tests of files."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from mcap_samples import calibration, estimates, names, recordings, rotations, seeds, stream, walk

from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet, keypoint_set
from vip_factors.estimate import CameraEstimate, DetectorEstimate, Estimate
from vip_factors.findings import bare
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, CameraMount, CameraTruth, Scene, Video

MODEL = CameraModel(640, 480, (500.0, 501.0), (320.0, 240.0))


def camera_path(rng: np.random.Generator, T: int) -> CameraPath:
    """Times to the nanosecond, as a file has them."""
    time = np.cumsum(rng.integers(1, 10**9, T)) / 1e9
    return CameraPath(time, rotations(rng, T), rng.normal(size=(T, 3)))


def detections(rng: np.random.Generator, F: int, keypoints: KeypointSet, most: int = 3) -> Detections:
    frame = np.repeat(np.arange(F), rng.integers(0, most + 1, F))
    N, K = len(frame), len(keypoints)
    pixels, confidence = rng.uniform(0, 480, (N, K, 2)), rng.uniform(0.1, 1, (N, K))
    lost = rng.random((N, K)) < 0.2
    pixels[lost], confidence[lost] = np.nan, 0.0
    return Detections(keypoints, rng.normal() + np.cumsum(rng.uniform(0.01, 0.1, F)), frame, pixels, confidence)


def filmed_walk(F: int = 20) -> Scene:
    """A wearer of six sensors and a fixed camera."""
    rng = np.random.default_rng(1)
    found = detections(rng, F, keypoint_set("coco17"))
    found = replace(found, time=np.arange(F) / 10)
    wearer = rng.integers(-1, 1, len(found))
    truth = CameraTruth(camera_path(rng, 1), wearer, found.pixels)
    return Scene("filmed", (walk(),), (Camera("phone", MODEL, found, moving=False, truth=truth),))


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    rng = np.random.default_rng(draw(seeds))
    keypoints = draw(
        st.sampled_from(list(KEYPOINT_SETS.values()))
        | st.lists(names, min_size=1, max_size=4).map(lambda given: KeypointSet("own", tuple(given)))
    )
    F = draw(st.integers(0, 6))
    distortion = tuple(rng.normal(size=draw(st.sampled_from([0, 4, 5, 8]))).tolist())
    images = {int(i): b"\xff\xd8" + rng.bytes(20) for i in rng.permutation(F + 3)[: draw(st.integers(0, 3))]}
    mount = CameraMount(stream(rng, draw(names), 4), rotations(rng), rng.normal(size=3), 0.2)
    return Camera(
        draw(names),
        CameraModel(640, 480, (rng.uniform(100, 900), 501.0), (rng.normal(), 240.0), distortion),
        detections(rng, F, keypoints),
        draw(st.booleans()),
        draw(st.sampled_from([None, mount])),
        draw(st.sampled_from([None, camera_path(rng, 1), camera_path(rng, 3)])),
        draw(st.sampled_from([VideoClock(), VideoClock(rng.normal(), 1e-3 * rng.normal())])),
        draw(st.sampled_from([None, Video(None, images)])),
    )


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    people = draw(st.lists(recordings(), min_size=1, max_size=3, unique_by=lambda one: one.subject.name))
    start_ns = draw(st.sampled_from([0, 1_700_000_000_000_000_000]))
    wearers = tuple(replace(person, start_ns=start_ns) for person in people)
    films = [
        replace(one, name=f"{number}/{one.name}", truth=draw(st.sampled_from([None, _truth(draw, one, len(wearers))])))
        for number, one in enumerate(draw(st.lists(cameras(), max_size=3)))
    ]
    return Scene(draw(names), wearers, tuple(films))


def _truth(draw: st.DrawFn, camera: Camera, wearers: int) -> CameraTruth:
    rng, N = np.random.default_rng(draw(seeds)), len(camera.detections)
    return CameraTruth(
        camera_path(rng, draw(st.integers(1, 3))),
        rng.integers(-1, wearers, N),
        draw(st.sampled_from([None, rng.normal(size=camera.detections.pixels.shape)])),
        draw(st.sampled_from([None, calibration(rng, ["imu"])["imu"]])),
        VideoClock(rng.normal(), 1e-3 * rng.normal()),
    )


@st.composite
def scene_estimates(draw: st.DrawFn) -> Estimate:
    rng = np.random.default_rng(draw(seeds))
    wearers = tuple(draw(st.lists(estimates(), min_size=1, max_size=3)))
    T, W = draw(st.integers(1, 4)), len(wearers)
    path = camera_path(rng, draw(st.sampled_from([1, T])))
    residual = np.where(rng.random((T, W)) < 0.3, np.nan, rng.uniform(0, 9, (T, W)))
    camera = CameraEstimate(
        draw(names),
        replace(MODEL, distortion=tuple(rng.normal(size=4).tolist())),
        replace(path, time=rng.normal() + path.time),
        draw(st.sampled_from([None, calibration(rng, ["imu"])["imu"]])),
        draw(st.sampled_from([None, rng.normal(size=(len(path), 6, 6))])),
        draw(st.sampled_from([None, residual])),
        VideoClock(rng.normal(), 1e-3 * rng.normal()),
        draw(st.sampled_from([None, (0.003, 2e-5)])),
        wearer_of_detection=rng.integers(-1, W, draw(st.integers(0, 5))),
    )
    K = draw(st.integers(0, 4))
    detector = DetectorEstimate(tuple("abcd"[:K]), *rng.normal(size=(3, K, 3)), np.full((K, 3), np.nan))
    return Estimate(
        draw(names),
        draw(names),
        wearers,
        draw(
            st.sampled_from(
                [(), (camera,), (camera, replace(camera, name="another", wearer_of_detection=np.arange(3)))]
            )
        ),
        wearers[0].reports,
        tuple(map(bare, draw(st.lists(names, max_size=2)))),
        draw(st.dictionaries(names, names, max_size=2)),
        draw(st.sampled_from([None, detector])),
        tuple(draw(st.lists(names, max_size=2))),
    )
