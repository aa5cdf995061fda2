"""The calibration found anew while tracking: what it knows, how tracking goes on with it."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from threading import Thread, current_thread

import numpy as np
import pytest
from filmed_gestures import filmed_gestures
from tracked import QUICK, SETTINGS, Tracked, filmed, track

from vip_factors.body.model_errors import FILMED
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array, angle_between, rotation_z, wrap_angle, yaw_of
from vip_factors.live import recalibrator
from vip_factors.live.assembly import FrameAssembler
from vip_factors.live.frames import MeasuredStretch
from vip_factors.live.recalibrator import RecalibrationProcess
from vip_factors.live.tracker import NOT_SEEN
from vip_factors.sensors.live import ImuSample, live_samples, sensor_columns, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import RecalibrationSettings

OFTEN = replace(SETTINGS, recalibration=RecalibrationSettings(first_s=2.5, delay_s=0.4))
EARLY = replace(QUICK, recalibration=RecalibrationSettings(first_s=1.5, delay_s=0.4))


def of_unknown_body(scene: Scene) -> Scene:
    """The scene with a wearer of whom the stature alone is known."""
    wearer = scene.wearers[0]
    subject = replace(wearer.subject, skeleton=None)
    return replace(scene, wearers=(replace(wearer, subject=subject),))


@pytest.fixture(scope="module")
def anew() -> Tracked:
    return track(of_unknown_body(filmed_gestures("fixed", 5.0)), settings=OFTEN)


def test_every_frame_is_answered_once_and_in_order(anew: Tracked) -> None:
    assert [answer.frame for answer in anew.answers] == list(range(len(anew.answers)))
    assert anew.answers[-1].time > 4.9


def test_the_body_changes_once_it_is_found(anew: Tracked) -> None:
    bodies = [answer.wearers[0].skeleton for answer in anew.answers]
    first, last = bodies[0], bodies[-1]
    assert first is not None
    assert last is not None
    when = next(answer.time for answer, body in zip(anew.answers, bodies, strict=True) if body is not first)
    assert 2.9 <= when < 3.2
    assert np.abs(last.p_parent_joint - first.p_parent_joint).max() > 1e-3


def test_answers_are_preliminary_until_then(anew: Tracked) -> None:
    begun = [answer.preliminary for answer in anew.answers]
    assert begun == sorted(begun, reverse=True)
    assert 2.9 <= next(answer.time for answer in anew.answers if not answer.preliminary) < 3.2


def test_answers_stay_near_the_truth(anew: Tracked) -> None:
    assert anew.error_mm("smoothed", after=3.2) < 60


def test_the_world_stays_as_it_was(anew: Tracked) -> None:
    """What is found anew has a world of its own; nobody sees a wearer leap into it."""
    poses = [answer.wearers[0].newest for answer in anew.answers if 2.8 < answer.time < 3.4]
    steps = np.linalg.norm(np.diff([pose.p_world_pelvis for pose in poses], axis=0), axis=1)
    yaws = yaw_of(np.stack([pose.R_parent_child[0] for pose in poses]))
    assert steps.max() < 0.06  # a pace at 30 Hz, and what is made up for
    assert np.abs(wrap_angle(np.diff(yaws))).max() < np.deg2rad(6)


def test_without_a_camera_tracking_goes_on_with_it_too() -> None:
    alone = track(replace(filmed_gestures("fixed", 3.6), cameras=()), settings=OFTEN)
    assert not alone.answers[-1].preliminary


def test_one_that_tracking_cannot_go_on_with_is_told() -> None:
    """No video comes after the first calibration's data: the next one takes its place before a wearer is seen again."""
    scene = of_unknown_body(filmed_gestures("fixed", 3.6))
    dark = [sample for sample in live_samples(scene) if isinstance(sample, ImuSample) or sample.time < 1.3]
    tracked = track(scene, dark, EARLY)
    told = [
        finding
        for answer in tracked.answers
        for finding in answer.findings
        if finding.kind == "calibration not renewed"
    ]
    assert [finding.words["reason"] for finding in told] == [NOT_SEEN]
    assert tracked.answers[-1].preliminary


def test_what_one_second_does_not_settle_is_told_only_if_more_does_not(anew: Tracked) -> None:
    """One second of these gestures leaves a forearm open; two seconds and a half settle it."""
    scene = of_unknown_body(filmed_gestures("fixed", 5.0))
    second = [sample for sample in live_samples(scene) if sample.time < 1.2]
    assert "does not determine" in track(scene, second, replace(SETTINGS, calibration_rate=7.5)).findings
    assert "does not determine" not in anew.findings


@pytest.fixture(scope="module")
def gestures() -> MeasuredStretch:
    scene = of_unknown_body(filmed_gestures("fixed", 5.0))
    head = stream_head(scene)
    assembler = FrameAssembler(sensor_columns(head), SETTINGS.frame_rate, SETTINGS.assembly, head.cameras, 8)
    return MeasuredStretch(head, [frame for sample in live_samples(scene) for frame in assembler.push(sample)])


def test_it_goes_on_from_what_was_found_before_unless_a_start_from_nothing_is_another(
    gestures: MeasuredStretch,
) -> None:
    first = recalibrator.recalibrate(gestures, OFTEN)

    def turned(angle: float) -> Array:
        """Mountings that are found, from ones of which a sensor's is turned."""
        own = first.shared.wearers[0]
        mountings = own.R_bone_sensor.copy()
        mountings[0] = mountings[0] @ rotation_z(angle)
        shared = replace(first.shared, wearers=(replace(own, R_bone_sensor=mountings),))
        return (
            recalibrator.recalibrate(gestures, OFTEN, None, replace(first, shared=shared))
            .shared.wearers[0]
            .R_bone_sensor
        )

    found = first.shared.wearers[0].R_bone_sensor
    assert np.array_equal(turned(np.deg2rad(120.0)), found)  # from nothing, as before
    again = turned(0.0)
    assert not np.array_equal(again, found)
    assert angle_between(again, found).max() < np.deg2rad(5.0)


def test_what_is_known_is_not_forgotten(anew: Tracked) -> None:
    """Straps and headings are far surer after the calibration was found anew than if nothing were known."""
    before, after = (
        next(answer for answer in anew.answers if answer.time > time).wearers[0].calibration for time in (2.8, 3.1)
    )
    for name in before:
        assert 0 < after[name].heading_sigma < 0.6
        assert np.all(after[name].mounting_sigma < 1.0)
        assert np.all(after[name].mounting_sigma > FILMED.mounting[joint_index(after[name].bone)])  # models err too
        assert np.rad2deg(abs(wrap_angle(after[name].heading - before[name].heading))) < 40


@pytest.mark.slow
def test_a_script_that_tracks_at_its_top_level_ends(tmp_path: Path) -> None:
    """No process may run a user's script again: it would track, and begin a process, and so on."""
    script = tmp_path / "session.py"
    script.write_text(
        "import sys\n"
        f"sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parent.parent)]!r}\n"
        "print('begun')\n"
        "from filmed_gestures import filmed_gestures\n"
        "from test_recalibration import OFTEN, track\n"
        "answers = track(filmed_gestures('fixed', 3.2), settings=OFTEN).answers\n"
        "print(len(answers), 'answers')\n"
    )
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=True)
    assert ended.stdout.split()[:1] == ["begun"]
    assert ended.stdout.count("begun") == 1
    assert "answers" in ended.stdout


def test_a_process_that_is_gone_is_told() -> None:
    process = RecalibrationProcess()
    process.close()
    answer = process.submit(MeasuredStretch(stream_head(filmed()), []), OFTEN)
    with pytest.raises(SolveError, match="has ended"):
        answer.result(timeout=30)


class Unpacked:
    """Tells in which thread it is pickled."""

    def __init__(self) -> None:
        self.threads = list[Thread]()

    def __reduce__(self) -> tuple[type, tuple[()]]:
        self.threads.append(current_thread())
        return dict, ()


def test_what_the_tracker_goes_on_changing_is_packed_before_it_does() -> None:
    process, known = RecalibrationProcess(), Unpacked()
    answer = process.submit(MeasuredStretch(stream_head(filmed()), []), OFTEN, known)  # type: ignore[arg-type]
    assert known.threads == [current_thread()]
    process.close()
    with pytest.raises(SolveError):
        answer.result(timeout=30)


def test_whatever_fails_is_an_answer() -> None:
    process, stretch = RecalibrationProcess(), MeasuredStretch(stream_head(filmed()), [])
    stretch.frames.append(lambda: "cannot be pickled")  # type: ignore[arg-type]
    with pytest.raises(SolveError, match="pickle"):
        process.submit(stretch, OFTEN).result(timeout=30)
    process.close()


def test_what_cannot_be_solved_is_told() -> None:
    process = RecalibrationProcess()
    answer = process.submit(MeasuredStretch(stream_head(filmed()), []), OFTEN)
    with pytest.raises(SolveError):
        answer.result(timeout=60)
    process.close()
