"""The report's page: every section is there, whatever is known; texts are escaped; nothing is asked of a network."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.findings import Finding, bare
from vip_factors.report.page import live_page, report_page, write_report
from vip_factors.report.report_data import motion_data, report_data
from vip_factors.sensors.calibration import Placement, SensorCalibration
from vip_factors.sensors.scene import Scene, Video
from vip_factors.simulate.gestures import gestures

ALWAYS = {"summary", "motion-section", "angles", "fit", "found", "recorded", "made"}
ERRORS = Injected(yaw=0.8, heading=0.2, camera_m=0.05)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return scene_sample(0.5)


@pytest.fixture(scope="module")
def estimate(scene: Scene) -> Estimate:
    """With residuals and covariance."""
    rng = np.random.default_rng(1)
    made = estimate_of(scene, ERRORS)
    return replace(made, wearers=tuple(_with_residuals(wearer, rng) for wearer in made.wearers))


def _with_residuals(one: WearerEstimate, rng: np.random.Generator) -> WearerEstimate:
    T, names = len(one.motion), tuple(one.calibration)
    sigma = np.broadcast_to(np.deg2rad(4.0) ** 2 * np.eye(3), (T, 24, 3, 3))
    residual = rng.uniform(0.5, 1.5, (T, len(names)))
    residual[T // 2 - 3 : T // 2 + 3] *= 10
    residuals = {"orientation_deg": residual, "acceleration_m_s2": 0.3 * residual}
    return replace(
        one, sensors=names, residuals=residuals, covariance=PoseCovariance(sigma, np.zeros((T, 3, 3)))
    )  # fmt: skip


class Page(HTMLParser):
    """Ids, elements and attributes of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.addresses: list[str] = []
        self.elements: list[str] = []
        self.data: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        for name, value in attrs:
            if name == "id" and value:
                self.ids.add(value)
            if name in ("src", "href", "srcset", "action", "data", "poster") and value:
                self.addresses.append(value)

    def handle_data(self, data: str) -> None:
        self.data.append(data)


@pytest.fixture(scope="module")
def text(estimate: Estimate, scene: Scene) -> str:
    """The page of both wearers, their truth and a camera."""
    return page_of(estimate, scene)


def page_of(estimate: Estimate, scene: Scene | None = None) -> str:
    return report_page(report_data(estimate, scene))


def motion_of(text: str) -> dict:
    return json.loads(re.search(r'id="motion">(.*?)</script>', text, re.DOTALL)[1])  # type: ignore[index]


def test_every_section_is_there_with_everything_known(text: str) -> None:
    assert Page(text).ids >= ALWAYS
    assert "Against the truth" in text
    motion = motion_of(text)
    assert [one["ghost"] for one in motion["bodies"]] == [False, True, False, True]
    assert [camera["name"] for camera in motion["cameras"]] == ["phone"]
    assert motion["frames"] == 16


def test_every_section_is_there_of_an_estimate_alone(estimate: Estimate) -> None:
    wearer = replace(estimate.wearers[0], covariance=None, residuals={})
    text = page_of(replace(estimate, cameras=(), wearers=(wearer,)))
    assert Page(text).ids >= ALWAYS
    assert "How sure the angles are was not computed" in text
    assert motion_of(text)["cameras"] == []
    assert len(motion_of(text)["bodies"]) == 1


def test_one_wearer_with_recording_in_a_file_that_is_never_replaced(
    estimate: Estimate, scene: Scene, tmp_path: Path
) -> None:
    alone = replace(estimate, wearers=estimate.wearers[:1], cameras=())
    path, recording = tmp_path / "report.html", Scene("one", scene.wearers[:1])
    write_report(alone, path, recording)
    with pytest.raises(InputError, match="exists"):
        write_report(alone, path, recording)
    assert path.stat().st_size < 3e6
    assert [entry.name for entry in tmp_path.iterdir()] == ["report.html"]
    text = path.read_text(encoding="utf-8")
    assert Page(text).ids >= ALWAYS
    assert "Knee flexion" in text
    assert "left_shank" in text
    site, worn = scene.wearers[0].placement.sites[0], motion_of(text)["bodies"][0]["sensors"]
    assert len(worn) == len(scene.wearers[0].placement.sites)
    assert (worn[0]["bone"], worn[0]["position"]) == (site.bone_index, pytest.approx(site.p_bone_sensor, abs=1e-4))


def test_names_are_escaped_everywhere(estimate: Estimate, scene: Scene) -> None:
    evil = '</script><img src=x onerror=alert(1)>"&<script>alert(1)</script>=1\n,\t{{ 7 * 7 }}'

    def renamed(calibration: Mapping[str, SensorCalibration]) -> dict[str, SensorCalibration]:
        return {f"{evil}{name}": sensor for name, sensor in calibration.items()}

    wearers = tuple(
        replace(
            recording,
            notes=evil,
            subject=replace(recording.subject, name=f"{evil}{number}"),
            imus={evil + name: replace(imu, name=evil + name) for name, imu in recording.imus.items()},
            placement=Placement(tuple(replace(site, sensor=evil + site.sensor) for site in recording.placement.sites)),
            truth=replace(recording.truth, calibration=renamed(recording.truth.calibration)),
        )
        for number, recording in enumerate(scene.wearers)
    )
    camera = replace(scene.camera, name=evil, video=Video(Path("/nowhere") / evil.replace("/", "")))
    named = replace(scene, name=evil, wearers=wearers, cameras=(camera,))
    wearer_estimates = tuple(
        replace(
            wearer,
            name=evil,
            method=evil,
            sensors=tuple(evil + name for name in wearer.sensors),
            calibration=renamed(wearer.calibration),
        )
        for wearer in estimate.wearers
    )
    named_estimate = replace(
        estimate,
        name=evil,
        method=evil,
        wearers=wearer_estimates,
        cameras=(replace(estimate.camera, name=evil),),
        findings=(Finding("hardly seen", evil, words={"seen": "never seen", "so": "unknown"}), bare(evil)),
        association=(evil,),
        settings={evil: evil},
    )
    page = Page(page_of(named_estimate, named))
    assert "x" not in page.addresses
    assert page.elements.count("script") == 3
    assert page.elements.count("img") == 1
    assert "".join(page.data).count(evil) > 40


def test_nothing_is_asked_of_a_network(text: str) -> None:
    page = Page(text)
    assert all(one.startswith(("#", "data:")) for one in page.addresses)
    assert "default-src 'none'" in text
    assert "link" not in page.elements
    assert "iframe" not in page.elements


def test_long_motions_are_thinned() -> None:
    motion = gestures(0.5)
    every = np.arange(40_000) % len(motion)
    long = replace(motion, R_parent_child=motion.R_parent_child[every], p_world_pelvis=motion.p_world_pelvis[every])
    shown = motion_data(report_data(Estimate.of_one(WearerEstimate("long", "SIP", long, {}))))
    assert shown["frames"] == 9000
    assert shown["rate"] == pytest.approx(motion.rate * 8999 / 39_999)


def test_what_does_not_belong_together_is_refused(estimate: Estimate, scene: Scene) -> None:
    with pytest.raises(InputError, match="estimate of 1 wearers"):
        report_data(replace(estimate, wearers=estimate.wearers[:1]), scene)
    with pytest.raises(InputError, match="no wearer"):
        report_data(replace(estimate, wearers=()))
    blind = replace(scene, wearers=tuple(replace(wearer, truth=None) for wearer in scene.wearers))
    with pytest.raises(InputError, match="no truth"):
        report_data(estimate, scene, blind)
    assert report_data(estimate, blind, scene).has_truth


def test_an_estimate_without_frames_is_refused(estimate: Estimate) -> None:
    cut = replace(estimate.wearers[0], motion=estimate.wearers[0].motion.frames(slice(0, 0)))
    with pytest.raises(InputError, match="has no frames to draw: was its file cut off"):
        report_data(replace(estimate, wearers=(cut, *estimate.wearers[1:])))


def test_the_live_page_has_every_camera(scene: Scene) -> None:
    page = live_page(replace(scene, cameras=(scene.camera, replace(scene.camera, name="left side"))))
    assert [
        page.count(f'"name": "{name}"') + page.count(f'"name":"{name}"') for name in (scene.camera.name, "left side")
    ] == [1, 1]
