"""Examples in the docstrings of the public functions run and print what they say."""

import doctest
from pathlib import Path

import pytest

import vip_factors as vip
from vip_factors import api

EXAMPLES = [test for test in doctest.DocTestFinder(recurse=True).find(api, "vip_factors") if test.examples]


@pytest.fixture(scope="module")
def namespace() -> dict[str, object]:
    scene = vip.simulate("walk", "sip6", seconds=6.0, seed=1)
    return {"vip": vip, "scene": scene, "estimate": vip.smooth(scene)}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_example_runs(
    example: doctest.DocTest, namespace: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra dev or notebook")
    monkeypatch.chdir(tmp_path)
    example.globs = dict(namespace)
    assert doctest.DocTestRunner().run(example).failed == 0


def test_there_are_examples() -> None:
    assert len(EXAMPLES) > 7
