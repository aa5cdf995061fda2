"""ANSUR II's files: units, what is missing, and the prior that the command makes of them."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.__main__ import main
from tests.studies.body_prior_training import DIMENSIONS, BodyTraining, centre_covariance, save_body_prior
from tests.studies.train_prior import read_ansur, train_body_prior_from_folder
from vip_factors.body.anthropometry import GROUPS, STATURE_ROW, VARIABLES, load_body_prior
from vip_factors.errors import FileFormatError, InputError

# Millimetres and tenths of a kilogram of a made-up person.
PERSON = {
    "stature": 1700, "weightkg": 700, "acromialheight": 1390, "acromionradialelength": 325, "radialestylionlength": 255,
    "handlength": 187, "biacromialbreadth": 390, "bicristalbreadth": 274, "trochanterionheight": 875,
    "lateralfemoralepicondyleheight": 480, "lateralmalleolusheight": 68, "cervicaleheight": 1460, "footlength": 260,
}  # fmt: skip


def write(folder: Path, people: int = 400, leave_out: str = "") -> Path:
    """Both files, of people about as different as people are."""
    random = np.random.default_rng(0)
    for sex in ("male", "female"):
        names = [name for name in DIMENSIONS if name != leave_out]
        rows = [",".join(["gender", *names])]
        for _ in range(people):
            values = [PERSON[name] * (1 + 0.03 * random.standard_normal()) for name in names]
            rows.append(",".join([sex, *(f"{value:.0f}" for value in values)]))
        (folder / f"{sex}.csv").write_text("\n".join(rows) + "\n")
    return folder


def test_units_are_metres_and_kilograms(tmp_path: Path) -> None:
    men = read_ansur(write(tmp_path))["male"]
    assert men["stature"].mean() == pytest.approx(1.7, abs=0.01)
    assert men["weightkg"].mean() == pytest.approx(70, abs=1)


def test_the_command_writes_a_prior(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "body.npz"
    assert main(["train-body", "--ansur", str(write(tmp_path)), "--out", str(out)]) == 0
    prior = load_body_prior(out)
    assert "400 male, 400 female" in capsys.readouterr().out
    assert prior.groups["both"].mean[VARIABLES.index("thigh")] == pytest.approx(0.412, abs=0.005)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"male\.csv and female\.csv"):
        read_ansur(tmp_path)
    with pytest.raises(InputError, match="20 people"):
        train_body_prior_from_folder(write(tmp_path, 20))
    with pytest.raises(FileFormatError, match="no column cervicaleheight"):
        read_ansur(write(tmp_path, 3, "cervicaleheight"))
    (tmp_path / "male.csv").write_text(",".join(DIMENSIONS) + "\n" + ",".join(["x"] * len(DIMENSIONS)) + "\n")
    with pytest.raises(FileFormatError, match="expected numbers"):
        read_ansur(tmp_path)


@pytest.mark.data
def test_the_shipped_prior_is_the_surveys(data_folder: Path) -> None:
    made, shipped = train_body_prior_from_folder(data_folder / "ansur2"), load_body_prior()
    assert made.provenance == shipped.provenance
    for name, group in made.groups.items():
        np.testing.assert_allclose(group.mean, shipped.groups[name].mean, atol=1e-9)
        np.testing.assert_allclose(group.covariance, shipped.groups[name].covariance, atol=1e-9)


def test_what_is_unsure_about_centres_leaves_stature_and_mass_alone() -> None:
    covariance = centre_covariance(BodyTraining())
    np.testing.assert_allclose(covariance @ STATURE_ROW, 0.0, atol=1e-12)
    np.testing.assert_array_equal(covariance[0], 0.0)


def test_a_written_prior_is_read_back(tmp_path: Path) -> None:
    prior, path = load_body_prior(), tmp_path / "body.npz"
    save_body_prior(prior, path)
    again = load_body_prior(path)
    assert again.provenance == prior.provenance
    for name in GROUPS:
        np.testing.assert_array_equal(again.groups[name].mean, prior.groups[name].mean)
        np.testing.assert_array_equal(again.groups[name].covariance, prior.groups[name].covariance)
