"""The package in a dozen names: quick to import, typed, and enough to get from sensors to a file of another program."""

import inspect
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Literal

import gtsam
import numpy as np
import pytest
from exercises import exercises
from simulated_walk import walk

import vip_factors as vip
from vip_factors.estimate import WearerEstimate
from vip_factors.gait.files import NAMES as GAIT_FILES
from vip_factors.geometry.rotations import Array
from vip_factors.repetitions.files import NAMES as REPETITION_FILES
from vip_factors.settings import SolverName, SolveSettings

QUICK = vip.Settings(frame_rate=20.0, solve=SolveSettings(max_iterations=3))


@pytest.fixture(scope="module")
def recording() -> vip.Scene:
    return vip.simulate(seconds=1.2, placement="sip6", seed=1)


@pytest.fixture(scope="module")
def estimate(recording: vip.Scene) -> vip.Estimate:
    return vip.smooth(recording, QUICK)


def python(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)


def test_the_import_takes_nothing_heavy_along() -> None:
    done = python(
        "import sys; before = set(sys.modules); import vip_factors\n"
        "new = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        "assert not new & {'numpy', 'scipy', 'gtsam', 'cv2', 'rerun', 'mcap', 'tyro', 'importlib.metadata'}, new\n"
    )
    assert done.returncode == 0, done.stderr


# What is promised (docs/python.md): a name or a parameter goes only after it has warned for two minor releases.
FUNCTIONS = {
    "convert": "log options cameras join",
    "detect": "video settings out overwrite progress",
    "evaluate": "estimate truth",
    "export": "estimate path settings overwrite",
    "factor_graph": "source settings progress",
    "gait": "estimate recording count out overwrite",
    "joint_angles": "motion",
    "live_samples": "scene",
    "open_source": "text follow real_time settings on_finding token",
    "picture": "shown path recording title poses overwrite",
    "read": "path then",
    "read_estimate": "path",
    "read_motion": "path",
    "repetitions": "estimate out overwrite",
    "report": "estimate path recording truth overwrite video video_height video_seconds",
    "run": "options progress",
    "serve": "worn port host token",
    "simulate": "motion placement camera seconds seed settings initial_pose pose_error_deg bystanders names name",
    "smooth": "source settings progress extra_factors",
    "stream": "source settings follow real_time token_file limits extra_factors",
    "sync": "scene max_offset",
    "write": "content path overwrite",
}
CLASSES = {
    "Camera": "", "CameraModel": "", "CameraOptions": "", "DetectSettings": "",
    "Detections": "from_arrays",
    "Estimate": "all_findings columns joint_angles positions to_dataframe to_xarray verdict wearer",
    "ExportSettings": "", "FixedLagTracker": "push finish", "ImportOptions": "", "ImuSample": "", "LiveEstimate": "",
    "LiveSettings": "", "Motion": "time state", "Recording": "from_arrays worn placed interval",
    "RunOptions": "", "Scene": "names cameras", "SceneSettings": "", "Settings": "",
    "SimulateSettings": "", "Stream": "estimates finish follow push push_poses take", "Subject": "", "VideoFrame": "",
    "VipFactorsError": "",
}  # fmt: skip


def test_the_public_names_are_there() -> None:
    assert vip.__all__ == sorted([*FUNCTIONS, *CLASSES, "JOINT_NAMES", "keys"]) == dir(vip)
    for name, parameters in FUNCTIONS.items():
        function = getattr(vip, name)
        assert list(inspect.signature(function).parameters) == parameters.split(), name
        assert set(inspect.get_annotations(function)) >= {*parameters.split(), "return"}, name
    for name, members in CLASSES.items():
        public = getattr(vip, name)
        assert inspect.isclass(public)
        assert public.__doc__
        assert all(hasattr(public, member) for member in members.split()), name
    with pytest.raises(AttributeError, match="solve_it"):
        vip.solve_it  # type: ignore[attr-defined]  # noqa: B018


def test_functions_stay_functions_beside_packages_of_their_names() -> None:
    packages = {name for name in FUNCTIONS if (Path(vip.__file__).parent / name).is_dir()}
    assert {"detect", "evaluate", "factor_graph", "gait", "repetitions", "report", "simulate"} <= packages
    done = python(
        "import inspect, vip_factors.evaluate.metrics, vip_factors.gait.files\n"
        "import vip_factors as vip\n"
        "from vip_factors.evaluate import metrics\n"
        "from vip_factors.api import evaluate\n"
        "assert metrics.FEET and vip.evaluate is evaluate\n"
        f"assert all(inspect.isfunction(getattr(vip, name)) for name in {packages})\n"
    )
    assert done.returncode == 0, done.stderr


def test_from_sensors_to_a_file_of_another_program(
    recording: vip.Scene, estimate: vip.Estimate, tmp_path: Path
) -> None:
    read = vip.read(vip.write(recording, tmp_path / "walk.mcap"))
    assert read.wearers[0].placed == recording.wearers[0].placed
    again = vip.read_estimate(vip.write(estimate, tmp_path / "walk.estimate.mcap"))
    np.testing.assert_allclose(
        again.wearers[0].motion.p_world_pelvis, estimate.wearers[0].motion.p_world_pelvis, atol=1e-9
    )
    assert vip.export(again, tmp_path / "walk.npz") == (tmp_path / "walk.npz",)
    assert (tmp_path / "walk.npz").stat().st_size > 0
    with pytest.raises(vip.VipFactorsError, match="ends in"):
        vip.export(estimate, tmp_path / "walk.odd")


def test_one_smooth_for_a_recording_and_a_scene(recording: vip.Scene, estimate: vip.Estimate) -> None:
    alone = vip.smooth(recording.wearers[0], QUICK)
    np.testing.assert_array_equal(alone.wearers[0].motion.R_parent_child, estimate.wearers[0].motion.R_parent_child)
    assert isinstance(recording.wearers[0], vip.Recording)
    assert vip.Settings().solver is SolverName.OWN


def test_objects_tell_of_themselves_in_a_few_lines(recording: vip.Scene, estimate: vip.Estimate) -> None:
    found = vip.evaluate(estimate, recording)
    for one in (recording, recording.wearers[0], estimate, estimate.wearers[0], found):
        assert 3 <= len(repr(one).splitlines()) <= 12
        assert one._repr_html_().startswith("<table><caption>")
    assert "verdict: " in repr(estimate)
    assert "6, 0.0 to " in repr(recording)
    assert "<th>positions</th><td>" in found._repr_html_()


def test_everything_public_shows_itself_in_a_few_lines(recording: vip.Scene, estimate: vip.Estimate) -> None:
    """Whatever a user meets by way of attributes, down to the arrays; collections by what they hold."""
    (worn,) = recording.wearers
    stream = vip.Stream(recording, vip.LiveSettings(frame_rate=20.0), real_time=False)
    answer = list(stream.estimates(vip.live_samples(recording)))[-1]
    filmed = vip.simulate(seconds=0.6, placement="sip6", camera="hand-held", seed=1, initial_pose="none")
    graph = vip.factor_graph(recording, QUICK)
    pending = [
        recording, worn, filmed, estimate, answer, graph, vip.evaluate(estimate, recording), estimate.joint_angles(),
        QUICK, vip.LiveSettings(), vip.SceneSettings(), vip.DetectSettings(), vip.ExportSettings(),
        vip.ImportOptions(), *vip.gait(walk()), *vip.repetitions(exercises(("squat",))),
    ]  # fmt: skip
    types, longest = set[type](), dict[str, int]()
    while pending:
        value = pending.pop()
        if is_dataclass(value):
            text = repr(value)
            longest[type(value).__name__] = max(longest.get(type(value).__name__, 0), len(text))
            assert len(text.splitlines()) <= 45, type(value)
            if type(value) not in types:
                pending += [getattr(value, field.name) for field in fields(value)]
            types.add(type(value))
        elif isinstance(value, Mapping | tuple):
            pending += list(value.values() if isinstance(value, Mapping) else value)[:2]
    assert {"FactorGraph", "SceneState", "ImuStream", "PoseCovariance", "LivePose", "CameraPath", "Settings"} <= {
        *longest
    }
    assert {name: length for name, length in longest.items() if length > 3000} == {}
    assert repr(graph).startswith(f"factor graph: {graph.graph.size()} factors on ")
    assert repr(QUICK).splitlines() == [
        "Settings, by default but for", "  frame_rate: 20.0", "  solve.max_iterations: 3"
    ]  # fmt: skip
    assert "R_parent_child: array (" in repr(answer.wearers[0].newest)


def test_gait_and_repetitions_tell_of_themselves_and_are_written(tmp_path: Path) -> None:
    (walked,) = vip.gait(walk(), out=tmp_path / "gait")
    assert repr(walked).splitlines()[0].endswith("events by the motion of the legs")
    assert "<th>speed</th><td>" in walked._repr_html_()
    (exercised,) = vip.repetitions(exercises(("squat", "squat")), out=tmp_path / "gym")
    assert repr(exercised).splitlines()[0] == "exercises: 2 squats"
    assert "<th>squat</th><td>" in exercised._repr_html_()
    made = {path.name for path in tmp_path.rglob("*.*")}
    assert made == {*GAIT_FILES, *REPETITION_FILES}
    with pytest.raises(vip.VipFactorsError, match="exists already"):
        vip.repetitions(exercises(("squat",)), out=tmp_path / "gym")


def test_what_is_no_recording_or_estimate_is_told(recording: vip.Scene, tmp_path: Path) -> None:
    with pytest.raises(vip.VipFactorsError, match=r"walk\.mcap: expected a recording or a scene, as vip\.read"):
        vip.smooth("walk.mcap")  # type: ignore[arg-type]
    with pytest.raises(vip.VipFactorsError, match=r"Scene simulated: expected an estimate, as vip\.smooth"):
        vip.report(recording, tmp_path / "walk.html")  # type: ignore[arg-type]


def test_an_estimate_as_angles_positions_and_columns(estimate: vip.Estimate) -> None:
    columns, angles = estimate.columns(), estimate.joint_angles()
    np.testing.assert_array_equal(columns["left_knee_flexion_deg"], angles.of("left_knee_flexion"))
    head = vip.JOINT_NAMES.index("head")
    np.testing.assert_array_equal(columns["head_z_m"], estimate.positions()[:, head, 2])
    assert list(estimate.columns(tables=["angles"]))[1].endswith("_deg")
    with pytest.raises(vip.VipFactorsError, match="expected 'Bea'"):
        estimate.positions("Bea")


def test_an_estimate_in_pandas(estimate: vip.Estimate) -> None:
    pandas = pytest.importorskip("pandas")
    table = estimate.to_dataframe()
    assert table.index.name == "time_s"
    assert table["head_z_m"].iloc[-1] == estimate.columns()["head_z_m"][-1]
    two = replace(estimate, wearers=(*estimate.wearers, renamed(estimate)))
    assert two.to_dataframe().index.names == ["wearer", "time_s"]
    assert isinstance(table, pandas.DataFrame)


def test_gait_and_repetitions_in_pandas_are_their_csv_files(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    (gait,) = vip.gait(walk(), out=tmp_path)
    (exercised,) = vip.repetitions(exercises(("squat", "squat")), out=tmp_path)
    tables = {name: gait.to_dataframe(name) for name in ("strides", "figures", "curves")}
    tables["repetitions"] = exercised.to_dataframe()
    for name, table in tables.items():
        written = pandas.read_csv(tmp_path / f"{name}.csv")
        pandas.testing.assert_frame_equal(table, written.drop(columns="wearer", errors="ignore"))
    assert tables["strides"]["length_m"].mean() == pytest.approx(
        np.mean([s.values["length"] for s in gait.strides]), abs=1e-3
    )
    assert set(tables["figures"]["side"]) == {"left", "right", "both", "difference"}
    assert list(tables["repetitions"]["kind"]) == ["squat", "squat"]
    (idle,) = vip.repetitions(walk())
    assert idle.to_dataframe().empty
    with pytest.raises(vip.VipFactorsError, match=r"no table 'stride'; did you mean 'strides'"):
        gait.to_dataframe("stride")


def test_an_estimate_has_the_dimensions_of_movement(estimate: vip.Estimate) -> None:
    pytest.importorskip("xarray")
    poses = replace(estimate, wearers=(*estimate.wearers, renamed(estimate))).to_xarray()
    assert poses.position.dims == ("time", "space", "keypoints", "individuals")
    assert poses.confidence.dims == ("time", "keypoints", "individuals")
    assert poses.attrs["ds_type"] == "poses"
    own = poses.position.sel(individuals="Bea", keypoints="head")
    np.testing.assert_array_equal(own, estimate.positions()[:, vip.JOINT_NAMES.index("head")])


def test_wearers_without_a_camera_are_told_apart_by_name(recording: vip.Scene) -> None:
    own = recording.wearers[0]
    ada, bea = (replace(own, subject=replace(own.subject, name=name)) for name in ("Ada", "Bea"))
    both = vip.smooth(vip.Scene("both", (ada, bea)), QUICK)
    np.testing.assert_array_equal(both.positions("Ada"), both.positions("Bea"))
    assert {finding.wearer for finding in both.all_findings} <= {"Ada", "Bea", ""}


def renamed(estimate: vip.Estimate) -> WearerEstimate:
    one = estimate.wearers[0]
    return replace(one, motion=replace(one.motion, name="Bea"))


def test_what_is_missing_is_told_with_the_pip_line(estimate: vip.Estimate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(vip.VipFactorsError, match=r"pip install 'vip-factors\[tables\]'"):
        estimate.to_dataframe()


def test_factors_of_your_own(recording: vip.Scene, estimate: vip.Estimate) -> None:
    """The pelvis is said to end a metre higher than it was found."""
    top = estimate.positions()[:, 0] + [0.0, 0.0, 1.0]
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.001)

    def raised(time: Array, first: int) -> gtsam.NonlinearFactorGraph:
        graph = gtsam.NonlinearFactorGraph()
        if len(time) == len(top):  # the frames of all, not the coarse ones
            for frame in range(first, first + len(time)):
                graph.add(gtsam.PriorFactorPoint3(vip.keys.root_key(frame), top[frame], noise))
        return graph

    found = vip.smooth(recording, QUICK, extra_factors=raised)
    np.testing.assert_allclose(found.positions()[:, 0], top, atol=0.05)


@pytest.mark.parametrize("camera", [None, "fixed"])
def test_progress_tells_standard_deviations_by_frames(camera: Literal["fixed"] | None) -> None:
    told = list[tuple[str, float]]()
    scene = vip.simulate(seconds=1.2, placement="sip6", camera=camera, seed=1)
    vip.smooth(scene, replace(QUICK, covariance=True), lambda *one: told.append(one))
    shares = [share for stage, share in told if stage == "standard deviations"]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert len(shares) > 6  # one for each frame


def test_run_does_what_the_command_does(recording: vip.Scene, tmp_path: Path) -> None:
    log = vip.write(recording, tmp_path / "walk.mcap")
    logs = ((log, vip.ImportOptions()),)
    found = vip.run(vip.RunOptions(logs, tmp_path / "made", settings=QUICK, report=False))
    assert found.wearers[0].motion.rate == 20.0
    assert (tmp_path / "made" / "estimate.mcap").is_file()
