import pickle
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.studies.fuzz.outcome import limited_memory
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.motions.amass import smpl_body

JOINTS = skeleton_from_stature(1.7).p_pelvis_joint + np.array([0.0, -0.2, 0.03])
# A body of very few vertices: one at each joint, then head, and heel and toes and fingertip of either side.
EXTRA = np.array([[0, 0.75, 0]] + [[x * 0.1, -1.2, z] for x in (1, -1) for z in (-0.08, 0.22)]
                 + [[x * 0.9, 0.5, 0] for x in (1, -1)])  # fmt: skip
VERTICES = np.concatenate([JOINTS, EXTRA])


def model(joints: int = 24) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    regressor = np.zeros((joints, len(VERTICES)))
    rows = {24: [*range(24)], 52: [*range(22), 25, 40], 55: [*range(22), 28, 43]}[joints]
    regressor[rows, range(24)] = 1.0
    return {"v_template": VERTICES, "shapedirs": rng.normal(0, 0.01, (len(VERTICES), 3, 10)), "J_regressor": regressor}


@pytest.mark.parametrize("joints", [24, 52, 55])
def test_joints_are_regressed_from_the_shaped_skin(tmp_path: Path, joints: int) -> None:
    arrays = model(joints)
    np.savez(tmp_path / "model.npz", **arrays, other=np.zeros(3))
    betas = [1.0, -2.0]
    body = smpl_body(tmp_path / "model.npz", betas)
    expected = (VERTICES + arrays["shapedirs"][:, :, :2] @ betas)[:24]
    np.testing.assert_allclose(body.p_model_pelvis, expected[0])
    np.testing.assert_allclose(body.skeleton.p_pelvis_joint, expected - expected[0], atol=1e-12)


def test_landmarks_are_the_extremes_of_the_skin(tmp_path: Path) -> None:
    np.savez(tmp_path / "model.npz", **model())
    body = smpl_body(tmp_path / "model.npz")
    at = {name: JOINTS[mark.bone] + mark.p_bone_point for name, mark in body.skeleton.landmarks.items()}
    np.testing.assert_allclose(at["head_top"], [0, 0.75, 0], atol=1e-12)
    np.testing.assert_allclose(at["left_heel"], [0.1, -1.2, -0.08], atol=1e-12)
    np.testing.assert_allclose(at["right_toe_tip"], [-0.1, -1.2, 0.22], atol=1e-12)
    np.testing.assert_allclose(at["left_fingertip"], [0.9, 0.5, 0], atol=1e-12)
    assert body.skeleton.stature == pytest.approx(1.95)


def fake_library(monkeypatch: pytest.MonkeyPatch, module: str, name: str) -> type:
    """A class that pickles as one of a library that need not be installed."""
    one = type(name, (), {"__module__": module})
    top, holder = module.partition(".")[0], ModuleType(module)
    monkeypatch.setitem(sys.modules, top, sys.modules.get(top, ModuleType(top)))
    monkeypatch.setitem(sys.modules, module, holder)
    setattr(holder, name, one)
    return one


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_pickles_of_chumpy_and_scipy_are_read_without_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, protocol: int
) -> None:
    arrays = model()
    path = tmp_path / "model.pkl"
    with monkeypatch.context() as patch:
        chumpy = fake_library(patch, "chumpy.ch", "Ch")()
        sparse = fake_library(patch, "scipy.sparse.csc", "csc_matrix")()
        chumpy.x = arrays["shapedirs"]  # type: ignore[attr-defined]
        columns = [np.flatnonzero(column) for column in arrays["J_regressor"].T]
        sparse.__dict__ |= {
            "_shape": arrays["J_regressor"].shape,
            "indices": np.concatenate(columns).astype(np.int32),
            "indptr": np.concatenate([[0], np.cumsum([len(column) for column in columns])]).astype(np.int32),
            "data": np.ones(sum(map(len, columns))),
        }
        content = arrays | {"shapedirs": chumpy, "J_regressor": sparse}
        path.write_bytes(pickle.dumps(content, protocol=protocol))
    np.savez(tmp_path / "model.npz", **arrays)
    from_pickle, from_npz = (smpl_body(tmp_path / f"model.{kind}", np.ones(10)).skeleton for kind in ("pkl", "npz"))
    np.testing.assert_allclose(from_pickle.p_parent_joint, from_npz.p_parent_joint, atol=1e-12)


class Harmful:
    """Unpickled by the usual means, it would write a file."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple:
        return Path.touch, (self.target,)


def test_nothing_in_a_pickle_is_run(tmp_path: Path) -> None:
    path, target = tmp_path / "model.pkl", tmp_path / "written"
    path.write_bytes(pickle.dumps({"v_template": Harmful(target)}))
    with pytest.raises(FileFormatError, match="no SMPL file needs"):
        smpl_body(path)
    assert not target.exists()


def test_other_files_are_refused_with_a_reason(tmp_path: Path) -> None:
    (tmp_path / "model.pkl").write_bytes(b"nothing")
    (tmp_path / "list.pkl").write_bytes(pickle.dumps([1, 2]))
    np.savez(tmp_path / "less.npz", v_template=VERTICES)
    np.savez(tmp_path / "shape.npz", **(model() | {"J_regressor": np.zeros((30, 5))}))
    np.savez(tmp_path / "model.npz", **model())
    for name, reason in (
        ("model.pkl", "not a SMPL model"),
        ("list.pkl", "holds a list"),
        ("less.npz", "lacks shapedirs, J_regressor"),
        ("shape.npz", r"J_regressor \(30, 5\)"),
        ("model.txt", r"\.npz or \.pkl"),
        ("absent.npz", "not a SMPL model npz"),
    ):
        with pytest.raises(FileFormatError, match=reason):
            smpl_body(tmp_path / name)
    with pytest.raises(InputError, match="at most 10"):
        smpl_body(tmp_path / "model.npz", np.zeros(11))


def test_a_template_of_one_number_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", v_template=np.array(1.0), shapedirs=np.zeros((4, 3, 2)), J_regressor=np.zeros((24, 4)))
    with pytest.raises(FileFormatError, match=r"v_template \(\) and shapedirs"):
        smpl_body(tmp_path / "a.npz")


def test_arrays_of_objects_are_none(tmp_path: Path) -> None:
    arrays = model() | {"v_template": np.array([[None, 1.0, 2.0]], dtype=object)}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(arrays, protocol=2))
    with pytest.raises(FileFormatError, match="an array of 'O8'"):
        smpl_body(tmp_path / "a.pkl")


@pytest.mark.parametrize("order", ["<", ">"])
def test_numbers_of_either_byte_order_are_read(tmp_path: Path, order: str) -> None:
    arrays = {name: np.asfortranarray(one.astype(f"{order}f4")) for name, one in model().items()}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(arrays, protocol=2))
    np.savez(tmp_path / "a.npz", **model())
    from_pickle, from_npz = (smpl_body(tmp_path / f"a.{kind}").skeleton for kind in ("pkl", "npz"))
    np.testing.assert_allclose(from_pickle.p_parent_joint, from_npz.p_parent_joint, atol=1e-6)


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x02}r\xff\xff\xff\x7f.",  # the two thousand millionth object
        b"\x80\x04\x8e\x00\x00\x00\x00\x00\x01\x00\x00.",  # a terabyte
        b"\x80\x02cnumpy\nndarray\nJ\xff\xff\xff\x7f\x85R.",  # an array of so many numbers
        b"\x80\x02}q\x00.",
    ],
)
def test_sizes_that_a_pickle_declares_are_not_made_room_for(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.pkl").write_bytes(content)
    with limited_memory(2**29), pytest.raises(FileFormatError, match=r"a\.pkl: (not a SMPL model pickle|lacks)"):
        smpl_body(tmp_path / "a.pkl")
