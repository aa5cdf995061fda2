"""What ships with the package and is learned from people: the pose prior and the prior over bodies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from tests.studies.study import Study, Tell
from vip_factors.body.body_prior import save_body_prior
from vip_factors.body.pose_prior import save_pose_prior
from vip_factors.body.train_body_prior import BodyTraining
from vip_factors.body.train_prior_settings import PriorTraining
from vip_factors.cli.outputs import Output
from vip_factors.errors import InputError
from vip_factors.io.ansur import train_body_prior_from_folder
from vip_factors.io.atomic import atomic_path, check_target
from vip_factors.io.motions.prior_training import train_prior_from_folder


@dataclass(frozen=True)
class Trained:
    """A file that was learned, what of, and how good it is if that was measured."""

    file: Path
    provenance: str
    measured: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Training(Study):
    """Common to what writes a file besides its row."""

    def tables(self, rows: Sequence[Trained]) -> Iterator[str]:
        for one in rows:
            yield "\n".join([one.provenance, *one.measured, str(one.file)])


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
