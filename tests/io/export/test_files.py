"""Estimates at another frame rate."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from animated import any_pose, filmed

from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.export.files import FORMATS, export, resampled
from vip_factors.io.settings import ExportSettings


def _camera(estimate: Estimate) -> CameraEstimate:
    assert estimate.camera is not None
    return estimate.camera


def test_half_the_rate_is_every_second_frame() -> None:
    estimate = filmed()[1]
    half = resampled(estimate, 30.0)
    for one, before in zip(half.wearers, estimate.wearers, strict=True):
        expected = before.motion.frames(slice(None, None, 2))
        assert len(one.motion) == len(expected)
        assert np.allclose(one.motion.R_parent_child, expected.R_parent_child, atol=1e-9)
        assert np.allclose(one.motion.p_world_pelvis, expected.p_world_pelvis, atol=1e-9)
        assert (one.motion.rate, one.motion.start) == (30.0, before.motion.start)
    assert np.allclose(_camera(half).path.p_world_camera, _camera(estimate).path.p_world_camera[::2], atol=1e-9)


def test_frames_in_between_lie_on_the_movement() -> None:
    estimate = filmed()[1]
    back = resampled(resampled(estimate, 30.0), 60.0)
    found, known = back.wearers[0].motion, estimate.wearers[0].motion.frames(slice(0, 31))
    assert len(found) == len(known)
    assert np.rad2deg(angle_between(found.R_parent_child, known.R_parent_child)).max() < 0.05
    assert np.abs(found.state.p_world_joint - known.state.p_world_joint).max() < 5e-4


def test_uncertainty_goes_along() -> None:
    estimate = filmed()[1]
    one, T = estimate.wearers[0], len(estimate.wearers[0].motion)
    sigma = np.linspace(1.0, 2.0, T)
    covariance = PoseCovariance(np.tile(np.eye(3), (T, 24, 1, 1)) * sigma[:, None, None, None], np.zeros((T, 3, 3)))
    one = replace(one, covariance=covariance)
    found = resampled(replace(estimate, wearers=(one,)), 40.0).wearers[0]
    assert np.allclose(found.covariance.joints[:, 5, 1, 1], 1.0 + found.motion.time / 0.5)


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".npz", ".pkl"])
def test_one_frame_can_be_written_at_any_rate(suffix: str, tmp_path: Path) -> None:
    (path,) = export(any_pose(frames=1), tmp_path / f"a{suffix}", ExportSettings(frame_rate=50.0))
    assert path.stat().st_size > 0


NAMES = ("a/b", "a_b", "Ada", "ada", "Ada", "Bea: 2", "..", "\u00e9", "e\u0301", "C\nD")
FILES = ("a_b", "a_b-2", "Ada", "ada-2", "Ada-3", "Bea_ 2", "_", "\u00e9", "e\u0301-2", "C_D")


def test_wearers_whose_names_make_one_file_name_get_files_of_their_own(tmp_path: Path) -> None:
    one = any_pose()
    wearers = tuple(replace(one.wearers[0], name=name) for name in NAMES)
    told: list[str] = []
    written = export(replace(one, wearers=wearers), tmp_path / "walk.mot", on_message=told.append)
    assert [path.name for path in written] == [f"walk.{name}.mot" for name in FILES]
    assert len({path.read_bytes() for path in written}) == 1
    assert len(list(tmp_path.iterdir())) == len(NAMES)
    assert "wearer 'a_b' is written as walk.a_b-2.mot" in told
    assert len(told) == sum(name != file for name, file in zip(NAMES, FILES, strict=True))


@pytest.mark.parametrize("suffix", [".bvh", ".csv", ".trc", ".mot", ".sto"])
def test_names_of_several_lines_leave_tables_as_they_are(suffix: str, tmp_path: Path) -> None:
    plain, odd = any_pose(), any_pose()
    odd = replace(odd, name="=1+1\t,x\nMOTION", wearers=(replace(odd.wearers[0], name="=1+1\t,x\nMOTION"),))
    texts = []
    for number, estimate in enumerate((plain, odd)):
        (path,) = export(estimate, tmp_path / f"{number}{suffix}")
        texts.append(path.read_text().splitlines())
    assert len(texts[0]) == len(texts[1])
    assert [line.count("\t") for line in texts[0]] == [line.count("\t") for line in texts[1]]
    assert sum(before != after for before, after in zip(*texts, strict=True)) == (suffix == ".trc")


LIMITED = """
import sys
from pathlib import Path
from resource import RLIM_INFINITY, RLIMIT_FSIZE, setrlimit
sys.path[:0] = {folders!r}
from animated import any_pose
from vip_factors.io.export.files import export
estimate, folder = any_pose(frames=300), Path({folder!r})
for suffix in {suffixes!r}:
    (whole,) = export(estimate, folder / ("whole" + suffix))
    size = whole.stat().st_size
    whole.unlink()
    for limit in (size // 2, size - 1):
        setrlimit(RLIMIT_FSIZE, (limit, RLIM_INFINITY))
        try:
            export(estimate, folder / ("a" + suffix))
            print(suffix, limit, "no error")
        except OSError:
            pass
        setrlimit(RLIMIT_FSIZE, (RLIM_INFINITY, RLIM_INFINITY))
        for left in folder.iterdir():
            print(left.name, "was left")
            left.unlink()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of files' sizes")
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    """The whole file but for a byte fits: libraries that tell of no error are found out."""
    folders = [str(Path(__file__).parent), str(Path(__file__).parents[2])]
    suffixes = [suffix for suffix in FORMATS if suffix != ".fbx"]  # Blender's own process
    program = LIMITED.format(folders=folders, folder=str(tmp_path), suffixes=suffixes)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
