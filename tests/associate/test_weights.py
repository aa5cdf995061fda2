"""Files of association weights: whatever is not one is refused."""

import re
from pathlib import Path

import pytest

from vip_factors.associate.weights import SHIPPED_WEIGHTS, load_weights
from vip_factors.errors import FileFormatError


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"provenance": "x", "unary": {"bias": 1}}', "\0"])
def test_other_files_are_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "weights.json"
    path.write_text(content)
    with pytest.raises(FileFormatError, match="not association weights"):
        load_weights(path)


@pytest.mark.parametrize("bias", ["1" + "0" * 400, "NaN", '"none"', "null"])
def test_a_bias_that_is_no_number_is_refused(tmp_path: Path, bias: str) -> None:
    path = tmp_path / "weights.json"
    path.write_text(re.sub(r'"bias": [-\d.e]+', f'"bias": {bias}', SHIPPED_WEIGHTS.read_text(), count=1))
    with pytest.raises(FileFormatError, match="not association weights"):
        load_weights(path)
