"""``python -m vip_factors`` is the command line."""

import runpy
import sys

import pytest


def test_the_package_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["vip_factors", "smoth"])
    with pytest.raises(SystemExit, match="2"):
        runpy.run_module("vip_factors", run_name="__main__")
    assert "Unrecognized options: smoth" in capsys.readouterr().err
