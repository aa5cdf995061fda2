"""What was trained, measured or kept: models of detectors and bodies, priors, weights, surveys, studies, tokens."""

import json
import os
import pickle
import zipfile
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from io import BytesIO, StringIO
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tests.studies.body_prior_training import DIMENSIONS
from tests.studies.fuzz.case import Case, installed, written
from tests.studies.fuzz.containers import protobuf_of
from tests.studies.train_prior import train_body_prior_from_folder
from vip_factors import __version__

PEOPLE = 230


def model_cases() -> list[Case]:
    """Each by what reads it."""
    from vip_factors.io.live.open import read_token

    survey = {f"{sex}.csv": _survey(seed) for seed, sex in enumerate(("male", "female"))}
    cases = [
        Case("ansur", survey, train_body_prior_from_folder, "python -m tests.studies train-body --ansur {}",
             seldom=6),
        Case("token", {"token.txt": b"c2VjcmV0\n"}, lambda folder: read_token(folder / "token.txt"),
             "vip-factors stream tcp://0.0.0.0:5555 --token-file {}/token.txt", seldom=3),
        Case("step-record", {"info.json": _record()}, _take_step, "vip-factors run", seldom=3),
        *_priors(), *_bodies(), _wheel(),
    ]  # fmt: skip
    if installed("onnxruntime"):
        command = "vip-factors detect VIDEO.mp4 --model {}/pose.onnx"
        cases.append(Case("onnx", {"pose.onnx": simcc_model()}, _onnx, command, seldom=3, apart=True))
    if installed("optuna"):
        for suffix in (".log", ".db"):
            cases.append(_study(suffix))
    return cases


def _survey(seed: int) -> bytes:
    """Of so many people, in millimetres."""
    random = np.random.default_rng(seed)
    rows = [[str(round(float(one))) for one in random.normal(600, 30, len(DIMENSIONS))] for _ in range(PEOPLE)]
    return "\n".join(",".join(row) for row in [list(DIMENSIONS), *rows]).encode()


def _record() -> bytes:
    told = ["note: a remark"]
    record = {"command": "vip-factors info", "version": __version__, "inputs": {}, "outputs": [], "told": told}
    return json.dumps(record).encode()


def _take_step(folder: Path) -> None:
    """One that does nothing, as ``run`` takes it again."""
    from vip_factors.cli.run import Step, take

    with redirect_stdout(StringIO()):
        take(Step("info", "info", (), (), ()), folder, main=lambda prog, words: None)


def _afresh(folder: Path, name: str, read: Callable[[Path], object]) -> None:
    """A copy of the file under a name that no cache knows."""
    with TemporaryDirectory(dir=folder) as inner:
        read(Path(copyfile(folder / name, Path(inner, name))))


def _priors() -> list[Case]:
    from vip_factors.associate.weights import SHIPPED_WEIGHTS, load_weights
    from vip_factors.body.body_prior import SHIPPED_BODY_PRIOR, load_body_prior
    from vip_factors.body.pose_prior import SHIPPED_PRIOR, load_pose_prior

    readers: dict[str, tuple[Path, Callable[[Path], object], str]] = {
        "weights": (SHIPPED_WEIGHTS, load_weights, "vip-factors smooth SCENE.mcap --association.weights {}/"),
        "pose-prior": (SHIPPED_PRIOR, load_pose_prior, "load_pose_prior {}/"),
        "body-prior": (SHIPPED_BODY_PRIOR, load_body_prior, "load_body_prior {}/"),
    }
    return [
        Case(name, {path.name: path.read_bytes()}, partial(_afresh, name=path.name, read=read), command + path.name,
             seldom=3)
        for name, (path, read, command) in readers.items()
    ]  # fmt: skip


def _bodies() -> list[Case]:
    """SMPL models of a few vertices, as both kinds of files."""
    from vip_factors.body.smpl_file import skeleton_from_smpl

    random = np.random.default_rng(0)
    content = {
        "v_template": random.normal(size=(30, 3)), "shapedirs": 0.01 * random.normal(size=(30, 3, 4)),
        "J_regressor": np.full((24, 30), 1 / 30) + 0.01 * random.normal(size=(24, 30)),
    }  # fmt: skip
    archive = BytesIO()
    np.savez(archive, **content)  # type: ignore[arg-type]
    files = {"smpl.npz": archive.getvalue(), "smpl.pkl": pickle.dumps(content, protocol=2)}

    def read(folder: Path, name: str) -> None:
        skeleton_from_smpl(folder / name, [0.5, 0.1])

    return [
        Case(
            name.replace(".", "-"), {name: data}, partial(read, name=name), f"skeleton_from_smpl {{}}/{name}", seldom=2
        )
        for name, data in files.items()
    ]


def _wheel() -> Case:
    """Of other models than the published ones, and so refused at last."""
    from vip_factors.detect.model_files import MEMBERS, blazepose_files
    from vip_factors.errors import FileFormatError

    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for member in MEMBERS.values():
            archive.writestr(member, b"a model" * 40)

    def read(folder: Path) -> None:
        os.environ.setdefault("XDG_CACHE_HOME", str(folder))
        try:
            blazepose_files(folder / "a.whl")
        except FileFormatError as error:
            if "SHA-256" not in str(error):
                raise

    return Case("wheel", {"a.whl": out.getvalue()}, read, "vip-factors detect VIDEO --blazepose {}/a.whl", seldom=3)


def simcc_model() -> bytes:
    """An ONNX model that answers any picture ``(1, 3, 8, 6)`` with the same rows of SimCC for 17 keypoints."""

    def field(number: int, content: bytes | str) -> tuple[int, int, bytes]:
        return number, 2, content.encode() if isinstance(content, str) else content

    def number(place: int, value: int) -> tuple[int, int, int]:
        return place, 0, value

    def value_info(name: str, shape: tuple[int, ...]) -> bytes:
        dimensions = protobuf_of([field(1, protobuf_of([number(1, one)])) for one in shape])
        tensor = protobuf_of([number(1, 1), field(2, dimensions)])  # 1: floats
        return protobuf_of([field(1, name), field(2, protobuf_of([field(1, tensor)]))])

    rows: list[tuple[int, int, Any]] = []
    for name, bins in (("x", 6), ("y", 8)):
        values = np.random.default_rng(bins).random((1, 17, bins)).astype("<f4").tobytes()
        tensor = protobuf_of(
            [*(number(1, one) for one in (1, 17, bins)), number(2, 1), field(8, name), field(9, values)]
        )
        node = protobuf_of([field(1, name), field(2, f"simcc_{name}"), field(4, "Identity")])
        rows += [field(1, node), field(5, tensor), field(12, value_info(f"simcc_{name}", (1, 17, bins)))]
    rows = sorted([*rows, field(2, "pose"), field(11, value_info("input", (1, 3, 8, 6)))], key=lambda one: one[0])
    opset = protobuf_of([number(2, 17)])
    return protobuf_of([number(1, 8), field(7, protobuf_of(rows)), field(8, opset)])


def _onnx(folder: Path) -> None:
    from vip_factors.detect.onnx_pose import Box, OnnxPose

    OnnxPose(folder / "pose.onnx", threads=1).look(np.zeros((48, 64, 3), np.uint8), Box(10, 5, 40, 45))


def _study(suffix: str) -> Case:
    """Two trials of one number."""
    from vip_factors.tune.parameters import DEFAULT_PARAMETERS
    from vip_factors.tune.study import Study, Task, best, report_lines

    one = DEFAULT_PARAMETERS[0]
    task = Task(("a.mcap",), (one,), {one.name: one.low}, "mpjpe")

    def go_on(path: Path) -> None:
        study = Study(path, task)
        study.run(2, lambda name, values: values[one.name])
        assert study.before is not None
        report_lines(study.trials, (one,), study.before, "mm")
        best(study.trials, study.before)

    def read(folder: Path) -> None:
        _afresh(folder, f"study{suffix}", go_on)

    made = written(lambda folder: go_on(folder / f"study{suffix}"))
    files = {one: data for one, data in made.items() if one.endswith(suffix)}
    command = f"vip-factors tune RECORDING.mcap --study {{}}/study{suffix} --trials 2"
    return Case(f"study-{suffix[1:]}", files, read, command, seldom=5 if suffix == ".log" else 40)
