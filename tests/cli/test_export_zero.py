"""Times of exported tables lie on the clock that the log has: a log from before zero, and one of absolute times."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.sensors.calibration import preset
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording

QUICK = ("--frame-rate", "20", "--solve.max-iterations", "2")
AXES = [f"q{axis}" for axis in "wxyz"] + [f"acc_{axis}" for axis in "xyz"]


def write_log(path: Path, start: float) -> np.ndarray:
    """A table of six sensors that share a time column, which begins at ``start``; the column is returned."""
    body = skeleton_from_stature(1.75)
    imus = simulate_recording(gestures(3.0, 60.0, body), preset("sip6", body)).imus
    count = min(len(stream.time) for stream in imus.values())
    time = start + np.arange(count) / next(iter(imus.values())).rate
    cells, names = [time], ["time"]
    for name, stream in imus.items():
        wxyz = quaternion_from_matrix(stream.R_inertial_sensor, Order.WXYZ)
        cells += [*wxyz[:count].T, *stream.specific_force[:count].T]
        names += [f"{name}_{axis}" for axis in AXES]
    np.savetxt(path, np.column_stack(cells), "%.6f", ",", header=",".join(names), comments="")
    return time


def times_of(path: Path) -> np.ndarray:
    """First column of a .csv, .mot or .sto; second of a .trc."""
    lines = path.read_text().splitlines()
    skip = {".csv": 1, ".trc": 6}.get(path.suffix) or next(n for n, line in enumerate(lines) if line == "endheader") + 2
    separator = "," if path.suffix == ".csv" else "\t"
    return np.array([float(line.split(separator)[path.suffix == ".trc"]) for line in lines[skip:]])


@pytest.mark.parametrize(("start", "zeros"), [(-5.403, ("log",)), (1.7e9 + 0.25, ("log", "absolute"))])
def test_times_are_those_of_the_log(run, tmp_path: Path, start: float, zeros: tuple[str, ...]) -> None:
    log, recording, estimate = tmp_path / "lab.csv", tmp_path / "lab.mcap", tmp_path / "lab.estimate.mcap"
    time = write_log(log, start)
    guess = tmp_path / "g"
    for words in (
        ("convert", log, "--template", guess),
        ("convert", log, recording, "--columns", f"{guess}_columns.toml", "--placement", f"{guess}_placement.toml"),
        ("smooth", recording, "--out", estimate, *QUICK),
    ):
        told = run(*words)
        assert told.code == 0, told.err
    files = [tmp_path / f"a{suffix}" for suffix in (".csv", ".trc", ".mot", ".sto", ".c3d")]
    assert run("export", estimate, *files[:4]).code == 0
    assert times_of(files[0])[0] == pytest.approx(0.0, abs=0.06)
    for zero in zeros:
        told = run("export", estimate, *files, "--zero", zero, "--overwrite")
        assert told.code == 0, told.err
        for path in files[:4]:
            written = times_of(path)
            assert np.diff(written) == pytest.approx(np.full(len(written) - 1, 0.05), abs=1e-5)
            assert written[0] == pytest.approx(time[0], abs=1e-5)
            assert time[-1] - 0.06 < written[-1] <= time[-1] + 0.06
        assert f"{start:.3f}".encode() in files[4].read_bytes()


def test_an_absolute_time_that_nobody_knows_is_refused(run, files, tmp_path: Path) -> None:
    told = run("export", files.estimate, tmp_path / "a.csv", "--zero", "absolute")
    assert told.code == 2
    assert "states no absolute time: expected --zero recording or --zero log" in told.err
