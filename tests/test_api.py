"""The package in a dozen names: quick to import, typed, and enough to get from sensors to a file of another program."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import vip_factors as vip
from vip_factors.evaluate.evaluation import Evaluation
from vip_factors.settings import SolverName
from vip_factors.solve.levenberg_marquardt import SolveSettings

QUICK = vip.Settings(frame_rate=20.0, solve=SolveSettings(max_iterations=3))


@pytest.fixture(scope="module")
def recording() -> vip.Scene:
    return vip.simulate(seconds=1.2, placement="sip6", seed=1)


@pytest.fixture(scope="module")
def estimate(recording: vip.Scene) -> vip.Estimate:
    return vip.smooth(recording, QUICK)


def python(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)


def test_the_import_takes_no_other_module_along() -> None:
    done = python(
        "import sys; before = set(sys.modules); import vip_factors\n"
        "new = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        "assert [name for name in sys.modules if name.startswith('vip_factors')] == ['vip_factors'], sys.modules\n"
        "assert not new & {'numpy', 'scipy', 'gtsam', 'cv2', 'rerun', 'mcap', 'tyro', 'importlib.metadata'}, new\n"
    )
    assert done.returncode == 0, done.stderr


def test_every_name_is_there() -> None:
    assert sorted(vip.__all__, key=str.lower) == sorted(set(vip.__all__), key=str.lower)
    assert len(vip.__all__) <= 16
    for name in vip.__all__:
        assert getattr(vip, name) is not None
        assert name in dir(vip)
        assert getattr(vip, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'solve_it'"):
        vip.solve_it  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("first", ["import vip_factors.evaluate.metrics", "import vip_factors.simulate.noise"])
def test_rooms_and_functions_of_the_same_name_are_both_there(first: str) -> None:
    """Python puts a room into the package when anybody imports it; what is called stays callable."""
    done = python(
        f"{first}\nimport vip_factors as vip, vip_factors.evaluate.metrics as joints\n"
        "assert joints.FEET and vip.evaluate.metrics is joints\n"
        "for room in (vip.evaluate, vip.simulate):\n"
        "    try: room(1, 2, 3, 4, 5, 6)\n"
        "    except TypeError as error: assert 'positional arguments' in str(error), error\n"
        "    else: raise AssertionError(room)\n"
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


def test_an_evaluation_printed_begins_with_five_lines(recording: vip.Scene, estimate: vip.Estimate) -> None:
    found = vip.evaluate(estimate, recording)
    assert isinstance(found, Evaluation)
    assert str(found).splitlines()[:5] == found.summary()
    one = vip.evaluate(estimate.wearers[0], recording.wearers[0])
    assert one["mpjpe"] == found["mpjpe"]


def test_one_smooth_for_a_recording_and_a_scene(recording: vip.Scene, estimate: vip.Estimate) -> None:
    alone = vip.smooth(recording.wearers[0], QUICK)
    np.testing.assert_array_equal(alone.wearers[0].motion.R_parent_child, estimate.wearers[0].motion.R_parent_child)
    assert isinstance(recording.wearers[0], vip.Recording)
    assert vip.Settings().solver is SolverName.OWN


def test_a_filmed_simulation_has_a_camera() -> None:
    scene = vip.simulate(seconds=1.2, placement="sip6", camera="fixed")
    assert scene.camera is not None
    assert scene.truth is not None


def test_a_log_is_converted(tmp_path: Path) -> None:
    with pytest.raises(vip.VipFactorsError, match="no such file"):
        vip.convert(tmp_path / "absent", vip.ImportOptions(stature_m=1.8))
