"""Top-down models in ONNX files: small ones, made here, that point at the brightest place of what they are shown."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from onnx_samples import simcc_model

from vip_factors.detect.models import Box, OnnxPose
from vip_factors.errors import FileFormatError, InputError

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

HEIGHT, WIDTH = 64, 48
Make = Callable[..., Path]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def made(
        nodes: list, outputs: dict[str, list], shape: list | None = None, kind: int = onnx.TensorProto.FLOAT
    ) -> Path:
        helper = onnx.helper
        given = helper.make_tensor_value_info("input", kind, shape or [1, 3, HEIGHT, WIDTH])
        told = [helper.make_tensor_value_info(name, kind, size) for name, size in outputs.items()]
        graph = helper.make_graph(nodes, "pose", [given], told, CONSTANTS)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.save(model, tmp_path / "model.onnx")
        return tmp_path / "model.onnx"

    return made


def integers(name: str, values: list[int]) -> object:
    return onnx.helper.make_tensor(name, onnx.TensorProto.INT64, [len(values)], values)


CONSTANTS = [integers("seventeen", [1, 17, 1]), integers("maps", [1, 26, 1, 1]), integers("one", [1])]


def simcc() -> tuple[list, dict[str, list]]:
    """Brightest column and row, of red alone, for each of 17 keypoints."""
    node = onnx.helper.make_node
    nodes = [
        node("Split", ["input"], ["red", "green", "blue"], axis=1),
        node("Squeeze", ["red", "one"], ["grey"]),
        node("ReduceMax", ["grey"], ["columns"], axes=[1], keepdims=1),
        node("ReduceMax", ["grey"], ["rows_up"], axes=[2], keepdims=1),
        node("Transpose", ["rows_up"], ["rows"], perm=[0, 2, 1]),
        node("Tile", ["columns", "seventeen"], ["simcc_x"]),
        node("Tile", ["rows", "seventeen"], ["simcc_y"]),
    ]
    return nodes, {"simcc_x": [1, 17, WIDTH], "simcc_y": [1, 17, HEIGHT]}


def heat() -> tuple[list, dict[str, list]]:
    """Heat maps of a quarter of the input's size for 26 keypoints."""
    node = onnx.helper.make_node
    nodes = [
        node("Split", ["input"], ["red", "green", "blue"], axis=1),
        node("MaxPool", ["red"], ["small"], kernel_shape=[4, 4], strides=[4, 4]),
        node("Tile", ["small", "maps"], ["heat"]),
    ]
    return nodes, {"heat": [1, 26, HEIGHT // 4, WIDTH // 4]}


def spot(x: int, y: int) -> np.ndarray:
    """An image with one red spot whose middle is there."""
    image = np.zeros((600, 800, 3), np.uint8)
    image[y - 8 : y + 8, x - 8 : x + 8, 0] = 255
    return image


@pytest.mark.parametrize("kind", [simcc, heat])
def test_keypoints_are_where_the_model_points(make: Make, kind: Callable) -> None:
    model = OnnxPose(make(*kind()), 1)
    box = Box(300, 100, 500, 500)
    pixels, confidence = model.look(spot(430, 260), box)
    assert model.keypoints.name == ("coco17" if kind is simcc else "halpe26")
    assert pixels.shape == (len(model.keypoints), 2)
    cell = 1.25 * 400 / HEIGHT * (1 if kind is simcc else 4)
    assert np.allclose(pixels, [430, 260], atol=cell)
    assert np.all(confidence == 1.0)  # clipped: a normalised 255 is above


def test_what_is_no_such_model(make: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such model file"):
        OnnxPose(tmp_path / "none.onnx", 1)
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(FileFormatError, match="expected an ONNX model"):
        OnnxPose(tmp_path / "text.onnx", 1)
    identity = [onnx.helper.make_node("Identity", ["input"], ["same"])]
    with pytest.raises(FileFormatError, match="of fixed size"):
        OnnxPose(make(identity, {"same": ["n", 3, "h", "w"]}, ["n", 3, "h", "w"]), 1)
    with pytest.raises(FileFormatError, match=r"\[1, 3, 2147483648, 6\].* 4096 at most"):
        OnnxPose(make(identity, {"same": [1, 3, 2**31, 6]}, [1, 3, 2**31, 6]), 1)
    with pytest.raises(FileFormatError, match=r"does not run .* expected one that takes \(1, 3, 64, 48\) floats"):
        OnnxPose(make(identity, {"same": [1, 3, HEIGHT, WIDTH]}, kind=onnx.TensorProto.DOUBLE), 1)
    with pytest.raises(InputError, match="gives 3 keypoints"):
        OnnxPose(make(identity, {"same": [1, 3, HEIGHT, WIDTH]}), 1)
    nodes, outputs = simcc()
    with pytest.raises(FileFormatError, match="expected SimCC's two"):
        OnnxPose(make(nodes[:-1], {"simcc_x": outputs["simcc_x"]}), 1)


def test_another_order_of_as_many_keypoints_can_be_named(make: Make) -> None:
    assert OnnxPose(make(*simcc()), 1, "coco17").keypoints.name == "coco17"
    with pytest.raises(InputError, match="halpe26 has 26"):
        OnnxPose(make(*simcc()), 1, "halpe26")


def test_a_name_that_is_no_text_is_refused(make: Make) -> None:
    path = make(*simcc())
    path.write_bytes(path.read_bytes().replace(b"input", b"in\xffut"))
    with pytest.raises(FileFormatError, match="expected an ONNX model"):
        OnnxPose(path, 1)


def test_a_model_without_an_input_is_refused(tmp_path: Path) -> None:
    path, model = tmp_path / "model.onnx", onnx.load_from_string(simcc_model())
    path.write_bytes(model.SerializeToString())
    assert OnnxPose(path, 1).keypoints.name == "coco17"
    del model.graph.input[:]
    path.write_bytes(model.SerializeToString())
    with pytest.raises(FileFormatError, match=r"input \[\]: expected one input"):
        OnnxPose(path, 1)
