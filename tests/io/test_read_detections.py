"""2D poses of every format come in alike; what is not as expected is refused with its place."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_files import People, person, write_alphapose, write_coco, write_mmpose, write_openpose

from vip_factors.body.keypoints import KEYPOINT_SETS
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.detection_formats import DetectionsWarning
from vip_factors.io.detections import read_detections

WRITERS: dict[str, tuple[Callable[..., Path], int]] = {  # and the number of a video's first frame
    "openpose": (write_openpose, 0),
    "alphapose.json": (write_alphapose, 0),
    "mmpose.json": (write_mmpose, 1),
    "coco.json": (write_coco, 0),
}


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(list(WRITERS)),
    st.sampled_from(list(KEYPOINT_SETS.values())),
    st.lists(st.integers(0, 3), min_size=1, max_size=6).filter(any),
    st.integers(0, 2**32 - 1),
)
@pytest.mark.filterwarnings("ignore::vip_factors.io.detection_formats.DetectionsWarning")
def test_every_format_gives_back_what_was_written(tmp_path_factory, file, keypoints, counts, seed) -> None:
    rng = np.random.default_rng(seed)
    write, first = WRITERS[file]
    counts[0] = max(counts[0], 1)  # formats without empty frames would not tell where the video begins and ends
    counts[-1] = max(counts[-1], 1)
    K = len(keypoints)
    people = {
        first + frame: [np.column_stack([rng.uniform(1, 900, (K, 2)), rng.uniform(0.1, 1, K)]) for _ in range(count)]
        for frame, count in enumerate(counts)
    }
    for here in people.values():
        for one in here:
            one[rng.random(K) < 0.2] = 0
            one[0] = 5, 6, 0.5  # nobody is without any point
    read = read_detections(write(tmp_path_factory.mktemp("poses") / file, people), 30.0, keypoints.name)
    assert read.keypoints == keypoints
    np.testing.assert_allclose(read.time, np.arange(len(counts)) / 30)
    np.testing.assert_array_equal(read.frame, np.repeat(np.arange(len(counts)), counts))
    written = np.array([one for here in people.values() for one in here])
    lost = written[..., 2] == 0
    np.testing.assert_array_equal(read.confidence, written[..., 2])
    assert np.isnan(read.pixels[lost]).all()
    np.testing.assert_array_equal(read.pixels[~lost], written[~lost][:, :2])


@pytest.mark.parametrize("name", ["coco17", "openpose18", "halpe26", "body25", "body25b"])
def test_the_set_is_told_by_number_and_by_looks(tmp_path: Path, name: str) -> None:
    write_openpose(tmp_path / "p", {0: [person(name)]})
    with warnings.catch_warnings():
        warnings.simplefilter("error" if name != "body25b" else "ignore")
        assert read_detections(tmp_path / "p", 30.0).keypoints.name == name


def test_of_two_sets_with_as_many_keypoints_the_guess_is_told(tmp_path: Path) -> None:
    write_openpose(tmp_path / "p", {0: [person("body25b")]})
    with pytest.warns(DetectionsWarning, match="taken as body25b, not body25"):
        read_detections(tmp_path / "p", 30.0)
    with pytest.warns(DetectionsWarning, match="read as body25, as asked, but people look like body25b"):
        assert read_detections(tmp_path / "p", 30.0, "body25").keypoints.name == "body25"
    nothing_to_see = np.tile([1.0, 2.0, 0.5], (25, 1))
    nothing_to_see[4:, 2] = 0
    write_openpose(tmp_path / "q", {0: [nothing_to_see]})
    with pytest.warns(DetectionsWarning, match="if they are body25b, say so"):
        assert read_detections(tmp_path / "q", 30.0).keypoints.name == "body25"


def test_names_in_the_file_must_agree_with_the_set(tmp_path: Path) -> None:
    names = KEYPOINT_SETS["coco17"].keypoints
    write_mmpose(tmp_path / "good.json", {1: [person()]}, names)
    assert read_detections(tmp_path / "good.json", 30.0).keypoints.name == "coco17"
    write_mmpose(tmp_path / "swapped.json", {1: [person()]}, (names[0], names[2], names[1], *names[3:]))
    with pytest.raises(FileFormatError, match=r"swapped\.json: keypoint 1 is 'right_eye', but 'left_eye'"):
        read_detections(tmp_path / "swapped.json", 30.0)
    write_mmpose(tmp_path / "h36m.json", {1: [person()]}, tuple(f"joint{i}" for i in range(17)))
    with pytest.raises(FileFormatError, match="not those of coco17"):
        read_detections(tmp_path / "h36m.json", 30.0)


def test_frames_that_a_file_passes_over_are_frames_without_people(tmp_path: Path) -> None:
    write_coco(tmp_path / "c.json", {7: [person()], 3: [person(), person(x=100)]})
    read = read_detections(tmp_path / "c.json", 10.0)
    assert len(read.time) == 8
    assert read.frame.tolist() == [3, 3, 7]
    assert read_detections(tmp_path / "c.json", 10.0, first_frame=3).frame.tolist() == [0, 0, 4]
    with pytest.raises(InputError, match="frame 3 lies before the first frame, 5"):
        read_detections(tmp_path / "c.json", 10.0, first_frame=5)


def test_confidences_beyond_one_are_scaled_and_outliers_cut(tmp_path: Path) -> None:
    people = {}
    for frame in range(100):
        one = person()
        one[:, 2] = np.linspace(0.1, 1.6, 17)
        people[frame] = [one]
    people[50][0][3, 2] = 90.0
    read = read_detections(write_alphapose(tmp_path / "a.json", people), 30.0)
    np.testing.assert_allclose(read.confidence[0], np.linspace(0.1, 1.6, 17) / 1.6)
    assert read.confidence.max() == 1.0


def test_nobody_at_all_is_no_error_of_the_file(tmp_path: Path) -> None:
    write_openpose(tmp_path / "p", {0: [], 1: []})
    read = read_detections(tmp_path / "p", 30.0)
    assert len(read) == 0
    assert len(read.time) == 2


def refused(path: Path, match: str, error: type[InputError] = FileFormatError, **options: object) -> None:
    with pytest.raises(error, match=match):
        read_detections(path, **{"rate": 30.0, **options})  # type: ignore[arg-type]


def test_what_is_not_as_expected_is_refused_with_its_place(tmp_path: Path) -> None:
    two: People = {0: [person()], 1: [person()]}
    refused(tmp_path / "none", "none: no such file", InputError)
    refused(write_coco(tmp_path / "a.json", two), "video rate 0 Hz", InputError, rate=0)
    refused(tmp_path / "a.json", "unknown keypoint set 'coco'", InputError, keypoints="coco")
    refused(tmp_path / "a.json", "17 keypoints, but body25 has 25", keypoints="body25")
    refused(write_coco(tmp_path / "b.json", {0: [person()], 900_000_000: [person()]}), "frame number 900000000")
    refused(write_coco(tmp_path / "c.json", {0: [person()], 1: [person("halpe26")]}), r"c\.json, entry 1: 26 keypoints")
    refused(write_coco(tmp_path / "d.json", {0: [person()[:11]]}), "have 11 keypoints: no known set")
    entries = json.loads((tmp_path / "a.json").read_text())
    del entries[1]["keypoints"]
    (tmp_path / "e.json").write_text(json.dumps(entries))
    refused(tmp_path / "e.json", r"e\.json: \[1\]\.keypoints is missing", InputError)
    entries[1]["keypoints"] = [1, 2, "x"]
    (tmp_path / "f.json").write_text(json.dumps(entries))
    refused(tmp_path / "f.json", r"f\.json: \[1\]\.keypoints\[2\]: expected number", InputError)
    entries[1]["keypoints"] = [1, 2]
    (tmp_path / "g.json").write_text(json.dumps(entries))
    refused(tmp_path / "g.json", r"entry 1: keypoints are 2 numbers: expected x, y, confidence")
    (tmp_path / "h.json").write_text(json.dumps(entries, indent=1)[:200])
    refused(tmp_path / "h.json", r"h\.json: .*line \d+ .*: expected 2D poses")
    (tmp_path / "i.json").write_text("[]")
    refused(tmp_path / "i.json", "list is empty")
    (tmp_path / "j.json").write_text('{"skeleton": 1}')
    refused(tmp_path / "j.json", "expected 2D poses as OpenPose")
    (tmp_path / "k.json").write_text("")
    refused(tmp_path / "k.json", r"k\.json: .*: expected 2D poses")
    for image, told in (("left.jpg", r"'left\.jpg'"), (5000 * "9", "'999")):
        entries = [{"image_id": image, "keypoints": person().ravel().tolist()}]
        (tmp_path / "l.json").write_text(json.dumps(entries))
        refused(tmp_path / "l.json", f"no frame number in {told}")


def test_fractions_of_the_image_are_no_pixels(tmp_path: Path) -> None:
    small = person() / [640, 480, 1]
    refused(write_coco(tmp_path / "a.json", {0: [small]}), r"between 0\.\d+ and 0\.\d+: expected pixels")


def test_a_folder_that_is_not_one_video_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "expected a folder with the JSON files of OpenPose")
    write_openpose(tmp_path / "p", {0: [person()]})
    write_openpose(tmp_path / "p", {0: [person()]}, prefix="other_")
    refused(tmp_path / "p", r"other_0+_keypoints\.json and walk_0+_keypoints\.json are both frame 0")
    write_openpose(tmp_path / "q", {0: [person()], 1: []})
    (tmp_path / "q" / "walk_000000000002_keypoints.json").write_text('{"people": {}}')
    refused(tmp_path / "q", r"walk_000000000002_keypoints\.json: people: expected list", InputError)


def test_files_beside_the_poses_are_left_out(tmp_path: Path) -> None:
    folder = write_openpose(tmp_path / "p", {frame: [person()] for frame in range(4)})
    for file in sorted(folder.glob("*.json")):
        (folder / f"._{file.name}").write_bytes(b"\0\5\x16\7Mac OS X")
    assert len(read_detections(folder, 30.0)) == 4
    (folder / "config.json").write_text('{"model": "BODY_25"}')
    with pytest.warns(DetectionsWarning, match=r"left out, without 2D poses: 1 file \(config\.json\)"):
        assert len(read_detections(folder, 30.0)) == 4


@pytest.mark.parametrize("number", [float, str, "walk.cam1_{}".format, "walk.v2.{:06d}.png".format])
def test_numbers_of_images_come_in_many_forms(tmp_path: Path, number: Callable[[int], float | str]) -> None:
    entries = [{"image_id": number(i), "keypoints": person().ravel().tolist()} for i in range(3)]
    (tmp_path / "a.json").write_text(json.dumps(entries))
    assert read_detections(tmp_path / "a.json", 30.0).frame.tolist() == [0, 1, 2]


@pytest.mark.parametrize(("categories", "count"), [([0, 0, 0], 3), ([1, 1, 2], 2), ([0, 1, 1], 2), ([7, 7, 7], 3)])
def test_persons_are_category_one_or_the_only_one(tmp_path: Path, categories: list[int], count: int) -> None:
    entries = [
        {"image_id": i, "category_id": category, "keypoints": person().ravel().tolist()}
        for i, category in enumerate(categories)
    ]
    (tmp_path / "a.json").write_text(json.dumps(entries))
    assert len(read_detections(tmp_path / "a.json", 30.0)) == count


def test_a_file_without_persons_names_its_categories(tmp_path: Path) -> None:
    entries = [{"image_id": i, "category_id": 2 + i, "keypoints": person().ravel().tolist()} for i in range(2)]
    (tmp_path / "a.json").write_text(json.dumps(entries))
    refused(tmp_path / "a.json", "categories are 2, 3: expected 1")


@pytest.mark.parametrize(("people", "keypoints"), [("people", "pose_keypoints_2d"), ("bodies", "joints")])
def test_alphapose_writes_all_images_into_one_file(tmp_path: Path, people: str, keypoints: str) -> None:
    frames = {f"{i}.jpg": {"version": "v0.3", people: [{keypoints: person().ravel().tolist()}]} for i in range(3)}
    (tmp_path / "a.json").write_text(json.dumps(frames))
    assert read_detections(tmp_path / "a.json", 30.0).frame.tolist() == [0, 1, 2]


@pytest.mark.parametrize("is_wrapped", [True, False])
def test_mmpose_writes_a_file_for_each_image(tmp_path: Path, is_wrapped: bool) -> None:
    instance = {
        "keypoints": person()[:, :2].tolist(),
        "keypoint_scores": person()[:, 2].tolist(),
        "bbox": [[0, 0, 9, 9]],
    }
    for i, instances in enumerate(([instance], [], [instance, instance])):
        content = {"meta_info": {}, "instance_info": instances} if is_wrapped else instances
        (tmp_path / f"frame_{i:04d}.json").write_text(json.dumps(content))
    assert read_detections(tmp_path, 30.0).frame.tolist() == [0, 2, 2]


def test_a_folder_with_one_file_for_all_frames(tmp_path: Path) -> None:
    write_mmpose(tmp_path / "walk.json", {1: [person()], 2: [person()]})
    assert len(read_detections(tmp_path, 30.0)) == 2


@pytest.mark.data
@pytest.mark.parametrize("camera", ["cam01", "cam02", "cam03", "cam04"])
def test_real_openpose_folders(data_folder: Path, camera: str) -> None:
    folder = data_folder / "pose2sim" / "balancing"
    with pytest.warns(DetectionsWarning, match="body25b"):
        read = read_detections(folder / "pose" / f"{camera}_json", 60.0)
    assert read.keypoints.name == "body25b"
    assert len(read.time) == 100
    assert np.bincount(read.frame).min() >= 1
    assert read.seen.mean() > 0.9
    assert read.confidence.max() <= 1
    cleaned = read_detections(folder / "pose-associated" / f"{camera}_json", 60.0, "body25b")
    assert len(cleaned) <= len(read)
