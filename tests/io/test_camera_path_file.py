"""Files of camera paths in the TUM format."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import exp
from vip_factors.io.camera_file import read_camera_path


@given(seed=st.integers(0, 2**16), start=st.floats(0, 1.7e9), comma=st.booleans())
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read(tmp_path: Path, seed: int, start: float, comma: bool) -> None:
    random = np.random.default_rng(seed)
    rotations, p = exp(random.standard_normal((5, 3))), random.standard_normal((5, 3))
    quaternions = [quaternion_xyzw(R) for R in rotations]
    time = start + 0.1 * np.arange(5)
    rows = np.column_stack([time, p, quaternions])[random.permutation(5)]
    lines = [(", " if comma else " ").join(f"{value:.9f}" for value in row) for row in rows]
    file = tmp_path / "path.txt"
    file.write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(lines) + "\n\n")
    path = read_camera_path(file)
    np.testing.assert_allclose(path.time, time, atol=1e-6)
    np.testing.assert_allclose(path.p_world_camera, p, atol=1e-8)
    np.testing.assert_allclose(path.R_world_camera, rotations, atol=1e-7)


def quaternion_xyzw(R: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]],
        ]
    )
    return vectors[:, np.argmax(values)]


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("0 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 1\n", FileFormatError, "line 2: expected eight numbers: time x y z"),
        ("0 0 0 0 0 0 0 1\n0.1 a 0 0 0 0 0 1\n", FileFormatError, "line 2"),
        ("0 0 0 0 0 0 0 1\n0.1 nan 0 0 0 0 0 1\n", FileFormatError, "line 2"),
        ("0 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1\n", FileFormatError, "1 poses: expected the camera's path"),
        ("", FileFormatError, "0 poses"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 1 1 1 1\n", InputError, "unit length"),
    ],
)
def test_what_is_no_path_is_one_sentence(tmp_path: Path, text: str, error: type[Exception], words: str) -> None:
    file = tmp_path / "path.txt"
    file.write_text(text)
    with pytest.raises(error, match=words):
        read_camera_path(file)
