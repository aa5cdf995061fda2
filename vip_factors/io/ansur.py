"""ANSUR II (2012): body dimensions of US Army personnel, as published (``male.csv`` and ``female.csv``).

One row per person; lengths in millimetres, ``weightkg`` in tenths of a kilogram.
"""

import csv
from pathlib import Path

import numpy as np

from vip_factors.body.body_prior import BodyPrior
from vip_factors.body.train_body_prior import DIMENSIONS, BodyTraining, train_body_prior
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

SEXES = ("male", "female")


def read_ansur(folder: str | Path) -> dict[str, dict[str, Array]]:
    """Dimensions of men and women: by sex and name, ``(n,)`` metres, and ``weightkg`` in kilograms.

    Raises:
        InputError: if a file is missing.
        FileFormatError: if it lacks a dimension or holds something else than numbers.
    """
    return {sex: _read(Path(folder) / f"{sex}.csv") for sex in SEXES}


def train_body_prior_from_folder(folder: str | Path, settings: BodyTraining | None = None) -> BodyPrior:
    """The prior over bodies of a folder with ANSUR II.

    Raises:
        InputError: if a file is missing, or there are too few people.
        FileFormatError: if it is not one of ANSUR II.
    """
    prior = train_body_prior(read_ansur(folder), settings)
    return BodyPrior(prior.groups, f"ANSUR II (2012): {prior.provenance}")


def _read(path: Path) -> dict[str, Array]:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected male.csv and female.csv of ANSUR II")
    with path.open(encoding="latin-1", newline="") as file:
        reader = csv.DictReader(file)
        missing = [name for name in DIMENSIONS if name not in (reader.fieldnames or ())]
        if missing:
            raise FileFormatError(f"{path}: no column {', '.join(missing)}: expected a file of ANSUR II")
        rows = list(reader)
    try:
        columns = {name: np.array([float(row[name]) for row in rows]) for name in DIMENSIONS}
    except (TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: expected numbers in {', '.join(DIMENSIONS)} ({error})") from error
    return {name: values / (10.0 if name == "weightkg" else 1000.0) for name, values in columns.items()}
