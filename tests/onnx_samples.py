"""Small models for ONNX Runtime."""

import numpy as np


def simcc_model() -> bytes:
    """An ONNX model that answers any picture ``(1, 3, 8, 6)`` with the same rows of SimCC for 17 keypoints."""
    from onnx import TensorProto, helper

    kind, bins = TensorProto.FLOAT, {"x": 6, "y": 8}
    values = {name: np.random.default_rng(size).random((1, 17, size)) for name, size in bins.items()}
    graph = helper.make_graph(
        [helper.make_node("Identity", [name], [f"simcc_{name}"]) for name in bins], "pose",
        [helper.make_tensor_value_info("input", kind, [1, 3, 8, 6])],
        [helper.make_tensor_value_info(f"simcc_{name}", kind, [1, 17, size]) for name, size in bins.items()],
        [helper.make_tensor(name, kind, rows.shape, rows.ravel()) for name, rows in values.items()],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    return bytes(model.SerializeToString())
