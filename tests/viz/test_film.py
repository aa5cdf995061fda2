"""Films: bodies lie where they are reprojected, rooms have floors and shadows, and files play."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.body.body_mesh import body_mesh
from vip_factors.errors import InputError
from vip_factors.sensors.scene import Scene, Video
from vip_factors.viz.colours import skin_colours, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, drawn_scene
from vip_factors.viz.eye import Eye, Lens, looking_at, room_model, scaled, viewpoints
from vip_factors.viz.figure import Figure, blend, lit_from
from vip_factors.viz.film import film, film_times, layout
from vip_factors.viz.film_panes import CameraPane, heading_errors
from vip_factors.viz.film_settings import FilmSettings
from vip_factors.viz.room import Backdrop, Room

SMALL = FilmSettings(video_height=96, video_rate=10.0)
LATE = replace(SMALL, video_seconds=(7.0, 9.0))


@pytest.fixture(scope="module")
def sample() -> Scene:
    return scene_sample(0.5)


@pytest.fixture(scope="module")
def drawn(sample: Scene) -> DrawnScene:
    return drawn_scene(sample, estimate_of(sample, Injected(heading=0.2)))


@pytest.fixture(scope="module")
def figures(drawn: DrawnScene) -> list[Figure]:
    return [Figure(body_mesh(w.shown.skeleton), w.shown, skin_colours(w.index)) for w in drawn.wearers]


def test_bodies_cover_their_reprojected_joints(drawn: DrawnScene, figures: list[Figure]) -> None:
    time = float(drawn.detections.time[6])
    at = drawn.path.at(np.array([time]))
    eye = Eye(scaled(drawn.model, 640, 360), at.R_world_camera[0], at.p_world_camera[0])
    for wearer, figure in zip(drawn.wearers, figures, strict=True):
        cover = blend(np.zeros((360, 640, 3), np.float32), eye, [figure.posed(time)], lit_from(eye))
        pixels = drawn.reprojected(wearer)[6] * 0.5
        names = drawn.detections.keypoints.keypoints
        limbs = [n for n, name in enumerate(names) if name.endswith(("shoulder", "elbow", "wrist", "hip", "knee"))]
        for x, y in np.round(pixels[limbs]).astype(int):
            assert cover[y, x] > 0.5
        assert 0.005 < cover.mean() < 0.2
        ys = np.nonzero(cover > 0.5)[0]
        reach = 0.12 * np.ptp(pixels[:, 1])  # a crown, a hand, a sole beyond the keypoints
        assert pixels[:, 1].min() - reach < ys.min()
        assert ys.max() < pixels[:, 1].max() + reach


def test_the_nearer_body_hides_the_other(figures: list[Figure]) -> None:
    one = figures[0].posed(0.2)
    middle = one.p.mean(axis=0)
    eye = looking_at(middle + np.array([4.0, 0.0, 0.3]), middle, room_model(120, 160))
    behind = replace(one, p=one.p - np.float32([1.0, 0, 0]), base=np.zeros_like(one.base) + np.float32([0, 0, 1]))
    pictures = []
    for bodies in ([one, behind], [behind, one]):
        image = np.ones((160, 120, 3), np.float32)
        blend(image, eye, bodies, lit_from(eye))
        pictures.append(image)
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-5)
    assert pictures[0][80, 60, 0] > pictures[0][80, 60, 2]  # orange, not blue


def test_half_an_opacity_shows_half_of_what_is_behind(figures: list[Figure]) -> None:
    body = figures[0].posed(0.2)
    eye = looking_at(body.p.mean(axis=0) + np.array([4.0, 0.0, 0.3]), body.p.mean(axis=0), room_model(120, 160))
    black, white, solid = (np.full((160, 120, 3), value, np.float32) for value in (0, 1, 0))
    cover = blend(black, eye, [body], lit_from(eye), 0.5)
    blend(white, eye, [body], lit_from(eye), 0.5)
    blend(solid, eye, [body], lit_from(eye))
    np.testing.assert_allclose(white - black, np.repeat(1 - 0.5 * cover[..., None], 3, axis=-1), atol=1e-5)
    np.testing.assert_allclose(solid, 2 * black, atol=1e-5)


def test_shadows_lie_under_bodies_and_tiles_in_their_places(figures: list[Figure]) -> None:
    body = figures[0].posed(0.2)
    floor = float(body.p[:, 2].min())
    foot = np.append(body.p[body.p[:, 2] < floor + 0.02].mean(axis=0)[:2], floor)
    eye = looking_at(foot + np.array([3.0, 1.0, 2.0]), foot, room_model(160, 120))
    backdrop = Backdrop(Room(floor, foot[:2], lit_from(eye)), Lens(eye.model))
    empty, shaded = backdrop.image(eye, []), backdrop.image(eye, [body.p])
    x, y = np.round(eye.project(foot)[0]).astype(int)
    assert shaded[y, x].mean() < 0.75 * empty[y, x].mean()
    np.testing.assert_allclose(shaded[:, :5], empty[:, :5], atol=1e-3)
    corner = np.array([np.round(foot[0] / 0.5) * 0.5, np.round(foot[1] / 0.5) * 0.5, floor])
    x, y = np.round(eye.project(corner)[0]).astype(int)
    off = np.round(eye.project(corner + np.array([0.25, 0.25, 0.0]))[0]).astype(int)
    assert empty[y, x].mean() < empty[off[1], off[0]].mean() - 0.02


def test_everybody_fits_into_the_room(drawn: DrawnScene) -> None:
    motions, times = [w.shown for w in drawn.wearers], np.linspace(0, 0.5, 6)
    model = room_model(200, 150)
    for eye in viewpoints(motions, -0.02, times, model):
        for motion in motions:
            pixels, depth = eye.project(motion.state.p_world_joint[::6])
            assert model.inside(pixels).all()
            assert (depth > 1).all()


def test_bodies_are_laid_over_the_video(sample: Scene, figures: list[Figure]) -> None:
    blue = np.full((90, 160, 3), (200, 60, 20), np.uint8)
    images = {n: cv2.imencode(".png", blue)[1].tobytes() for n in range(3)}
    filmed = replace(sample, camera=replace(sample.camera, video=Video(None, images)))
    drawn = drawn_scene(filmed, estimate_of(filmed))
    pane = CameraPane(drawn, figures, drawn.detections.time[:4], np.arange(4), (160, 90), 0.6)
    first = pane.draw(0)
    assert np.abs(first[:3].astype(int) - [20, 60, 200]).max() <= 1
    x, y = np.round(drawn.reprojected(drawn.wearers[0])[0, 5] / 8).astype(int)  # left shoulder
    assert np.abs(first[y, x].astype(int) - [20, 60, 200]).max() > 40
    for index in (1, 2, 3):
        last = pane.draw(index)
    assert last[:3].min() > 200  # no picture there: the room in its place


def test_skeletons_lie_where_their_joints_are_seen(sample: Scene, figures: list[Figure]) -> None:
    drawn = drawn_scene(sample, estimate_of(sample))
    pane = CameraPane(drawn, figures, drawn.detections.time[6:7], np.array([6]), (640, 360), None)
    picture, time = pane.draw(0), float(drawn.detections.time[6])
    at = drawn.path.at(np.array([time]))
    eye = Eye(scaled(drawn.model, 640, 360), at.R_world_camera[0], at.p_world_camera[0])
    for wearer in drawn.wearers:
        frame = round((time - wearer.shown.start) * wearer.shown.rate)
        joints, _ = eye.project(wearer.shown.state.p_world_joint[frame])
        for ends in ((4, 7), (5, 8)):  # of the shanks
            x, y = np.round(joints[list(ends)].mean(axis=0)).astype(int)
            assert np.abs(picture[y, x].astype(int) - wearer_colour(wearer.index)).max() < 40
    assert np.abs(picture[:20].astype(int) - picture[0, 0]).max() == 0  # a plain ground


def test_a_film_shows_the_frames_that_are_left_of_a_video(sample: Scene) -> None:
    images = dict.fromkeys(range(0, 16, 3), cv2.imencode(".png", np.zeros((9, 16, 3), np.uint8))[1].tobytes())
    filmed = replace(sample, camera=replace(sample.camera, video=Video(Path("gone.mp4"), images)))
    _, frames, rate = film_times(drawn_scene(filmed, estimate_of(filmed)), FilmSettings())
    np.testing.assert_array_equal(frames, range(0, 16, 3))
    assert rate == pytest.approx(10)


@pytest.mark.parametrize("suffix", [".mp4", ".webp", ".gif"])
def test_films_open_with_their_number_of_pictures(drawn: DrawnScene, tmp_path: Path, suffix: str) -> None:
    path, told = tmp_path / f"a{suffix}", []
    film(drawn, path, SMALL, on_progress=lambda _, share: told.append(share))
    times, _, rate = film_times(drawn, SMALL)
    assert (len(times), round(rate)) == (6, 10)
    assert told[-2:] == [1, 0]  # all drawn, then written
    width, height, _ = layout(drawn, 96, headings=False)
    if suffix == ".mp4":
        reader, pictures = cv2.VideoCapture(str(path)), []
        while (got := reader.read())[0]:
            pictures.append(got[1])
        assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(10)
    else:
        from PIL import Image, ImageSequence

        with Image.open(path) as image:
            pictures = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(image)]
    assert len(pictures) == 6
    assert pictures[0].shape == (height, width, 3)
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="exists"):
        film(drawn, path, SMALL)


def test_a_wearer_without_camera_is_filmed_in_the_room_alone(sample: Scene, tmp_path: Path) -> None:
    estimate = estimate_of(sample)
    alone = drawn_scene(None, replace(estimate, camera=None, wearers=estimate.wearers[:1]))
    film(alone, tmp_path / "a.mp4", replace(SMALL, video_seconds=(0.1, 0.3)))
    reader = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert int(reader.get(cv2.CAP_PROP_FRAME_COUNT)) == len(
        film_times(alone, replace(SMALL, video_seconds=(0.1, 0.3)))[0]
    )
    assert (reader.get(cv2.CAP_PROP_FRAME_WIDTH), reader.get(cv2.CAP_PROP_FRAME_HEIGHT)) == (170, 96)


def test_heading_errors_are_those_injected(drawn: DrawnScene, tmp_path: Path) -> None:
    wearers = [wearer.estimate.calibration for wearer in drawn.wearers]
    histories = [(np.array([0.1, 0.4]), [one, one]) for one in wearers]
    errors = heading_errors(drawn, histories)
    assert [values.shape for _, _, values in errors] == [(3, 13)] * 2
    # One sensor of 13 is 0.2 rad off, which turns their mean by a thirteenth of that.
    feet = list(wearers[0]).index("left_foot")
    assert errors[0][2][-1, feet] == pytest.approx(np.rad2deg(0.2) * 12 / 13, abs=0.1)
    assert np.abs(errors[0][2][0]).max() > 20  # as they came
    film(drawn, tmp_path / "a.webp", SMALL, histories)
    with pytest.raises(InputError, match="live estimate"):
        film(drawn, tmp_path / "b.webp", SMALL, [(np.zeros(1), [wearers[0]])])


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda drawn, folder: film(drawn, folder / "a.avi", SMALL), "end in .mp4, .webp, .gif"),
        (lambda drawn, folder: film(drawn, folder / "no" / "a.mp4", SMALL), "no folder"),
        (lambda drawn, folder: film(drawn, folder / "a.mp4", LATE), "nothing to film"),
        (lambda drawn, folder: FilmSettings(video_height=10), "64 or more and 2160 at most"),
        (lambda drawn, folder: FilmSettings(video_seconds=(2.0, 1.0)), "later end"),
    ],
)  # fmt: skip
def test_what_cannot_be_filmed_is_said(drawn: DrawnScene, tmp_path: Path, make: Callable, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make(drawn, tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_animation_too_large_for_memory_is_refused(
    drawn: DrawnScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vip_factors.viz.film.LARGEST_ANIMATION", 100_000)
    with pytest.raises(InputError, match="too large to make"):
        film(drawn, tmp_path / "a.gif", SMALL)


@pytest.mark.parametrize("headings", [True, False])
def test_panes_of_an_upright_video_keep_its_shape(drawn: DrawnScene, headings: bool) -> None:
    upright = replace(drawn, model=scaled(drawn.model, 1080, 1920))
    width, height, boxes = layout(upright, 480, headings)
    assert boxes["camera"][2] / boxes["camera"][3] == pytest.approx(1080 / 1920, abs=0.01)
    assert width % 2 == height % 2 == 0
    for left, top, w, h in boxes.values():
        assert left >= 0 <= top
        assert left + w <= width
        assert top + h <= height


@pytest.mark.parametrize(("suffix", "module"), [(".mp4", "av"), (".gif", "PIL.Image")])
def test_a_missing_library_is_named_with_its_extra(
    drawn: DrawnScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"pip install 'vip-factors\[film\]'"):
        film(drawn, tmp_path / f"a{suffix}", SMALL)
