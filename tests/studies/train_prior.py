"""What ships with the package and is learned from people: the pose prior and the prior over bodies.

The latter is of ANSUR II (2012): body dimensions of US Army personnel, as published (``male.csv`` and ``female.csv``).
One row per person; lengths in millimetres, ``weightkg`` in tenths of a kilogram.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from tests.studies.body_prior_training import DIMENSIONS, BodyTraining, save_body_prior, train_body_prior
from tests.studies.pose_prior_training import (
    DAMAGED_CLIPS,
    PriorTraining,
    held_out_names,
    save_pose_prior,
    train_pose_prior,
)
from tests.studies.study import Study, Tell
from vip_factors.atomic import atomic_path, check_target
from vip_factors.body.anthropometry import BodyPrior
from vip_factors.body.joint_priors import PosePrior
from vip_factors.cli.options import Output
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.motions.files import MOTION_SUFFIXES, motion_files, read_motion

SEXES = ("male", "female")


@dataclass(frozen=True)
class Trained:
    """A file that was learned, and what of."""

    file: Path
    provenance: str


@dataclass(frozen=True, kw_only=True)
class Training(Study):
    """Common to what writes a file besides its row."""

    def tables(self, rows: Sequence[Trained]) -> Iterator[str]:
        for one in rows:
            yield f"{one.provenance}\n{one.file}"


@dataclass(frozen=True, kw_only=True)
class TrainPrior(Training):
    """Learn the pose prior, a Gaussian over joint rotations, from a folder of motions."""

    motions: Path
    """Folder of motion files, searched with all folders below it."""
    out: Annotated[Path, Output(".npz")]
    """File (.npz) to write; --overwrite replaces it."""
    hold_out: tuple[str, ...] | None = None
    """Names of files (without suffix) never to train on; those that the package evaluates on if absent."""
    training: Annotated[PriorTraining, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=PriorTraining)

    def rows(self, tell: Tell) -> Iterator[Trained]:
        check_target(self.out, self.overwrite)
        if not self.motions.is_dir():
            raise InputError(f"{self.motions}: expected a folder of motion files")
        prior = train_prior_from_folder(self.motions, self.hold_out, self.training)
        with atomic_path(self.out, self.overwrite) as partial:
            save_pose_prior(prior, partial)
        yield Trained(self.out, prior.provenance)


@dataclass(frozen=True, kw_only=True)
class TrainBody(Training):
    """Learn the prior over bodies, Gaussians over mass and lengths, from the survey ANSUR II."""

    ansur: Path
    """Folder with male.csv and female.csv of ANSUR II."""
    out: Annotated[Path, Output(".npz")]
    """File (.npz) to write; --overwrite replaces it."""
    training: Annotated[BodyTraining, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=BodyTraining)

    def rows(self, tell: Tell) -> Iterator[Trained]:
        check_target(self.out, self.overwrite)
        prior = train_body_prior_from_folder(self.ansur, self.training)
        with atomic_path(self.out, self.overwrite) as partial:
            save_body_prior(prior, partial)
        yield Trained(self.out, prior.provenance)


def train_prior_from_folder(
    folder: str | Path, hold_out: Sequence[str] | None = None, settings: PriorTraining | None = None
) -> PosePrior:
    """Learned from every motion file in a folder and below, but for the held-out clips and known damaged ones."""
    held_out = tuple(held_out_names() if hold_out is None else hold_out)
    folder = Path(folder)
    paths = motion_files(folder)
    chosen = [path for path in paths if path.stem not in held_out + DAMAGED_CLIPS]
    if not chosen:
        raise InputError(f"{folder}: no motion file to train on; expected files ending in {', '.join(MOTION_SUFFIXES)}")
    prior = train_pose_prior(map(read_motion, chosen), settings)
    skipped = sorted({path.stem for path in paths} - {path.stem for path in chosen})
    provenance = (
        f"Gaussian over joint rotations of {prior.provenance}; trained by 'python -m tests.studies "
        f"train-prior' on the folder '{folder.name}'; left out: {', '.join(skipped) or 'none'}"
    )
    return PosePrior(prior.mean, prior.whitening, provenance)


def read_ansur(folder: str | Path) -> dict[str, dict[str, Array]]:
    """Dimensions of men and women: by sex and name, ``(n,)`` metres, and ``weightkg`` in kilograms."""
    return {sex: _read(Path(folder) / f"{sex}.csv") for sex in SEXES}


def train_body_prior_from_folder(folder: str | Path, settings: BodyTraining | None = None) -> BodyPrior:
    """The prior over bodies of a folder with ANSUR II."""
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
