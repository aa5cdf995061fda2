"""The pose prior from a folder of motion files."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from vip_factors.body.held_out_clips import DAMAGED_CLIPS, held_out_names
from vip_factors.body.motion import Motion
from vip_factors.body.pose_prior import PosePrior
from vip_factors.body.train_prior import train_pose_prior
from vip_factors.body.train_prior_settings import PriorTraining
from vip_factors.errors import InputError
from vip_factors.io.motions.files import MOTION_SUFFIXES, motion_files, read_motion


def train_prior_from_folder(
    folder: str | Path, hold_out: Sequence[str] | None = None, settings: PriorTraining | None = None
) -> PosePrior:
    """Train on every motion file in a folder and below, but for the held-out clips and known damaged ones.

    Args:
        folder: where the files are.
        hold_out: stems of files never to train on; those of ``held_out_clips`` if not given.
        settings: how frames become a Gaussian.

    Raises:
        InputError: if the folder holds no motion file, or too few frames.
    """
    held_out = tuple(held_out_names() if hold_out is None else hold_out)
    folder = Path(folder)
    paths = motion_files(folder)
    chosen = [path for path in paths if path.stem not in held_out + DAMAGED_CLIPS]
    if not chosen:
        raise InputError(f"{folder}: no motion file to train on; expected files ending in {', '.join(MOTION_SUFFIXES)}")
    prior = train_pose_prior(_read(chosen), settings)
    skipped = sorted({path.stem for path in paths} - {path.stem for path in chosen})
    provenance = (
        f"Gaussian over joint rotations of {prior.provenance}; trained by 'python -m tests.studies "
        f"train-prior' on the folder '{folder.name}'; left out: {', '.join(skipped) or 'none'}"
    )
    return PosePrior(prior.mean, prior.whitening, provenance)


def _read(paths: Sequence[Path]) -> Iterator[Motion]:
    for path in paths:
        yield read_motion(path)
