"""The page about public recordings shows placements that are placements."""

import re
import tomllib
from pathlib import Path

from vip_factors.io.placement_file import placement_from_file

PAGE = (Path(__file__).parents[2] / "docs" / "converting.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)


def test_placements_are_placements(tmp_path: Path) -> None:
    placements = [text for kind, text in BLOCKS if kind == "toml"]
    assert len(placements) == 2
    for text in placements:
        path = tmp_path / "placement.toml"
        path.write_text(text)
        assert set(placement_from_file(path).sensors) == set(tomllib.loads(text)["sensors"])
