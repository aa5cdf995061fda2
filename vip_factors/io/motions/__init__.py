"""Motion files of other people, brought onto our skeleton: BVH, AMASS. One door to them, by their suffix."""

from collections.abc import Callable
from pathlib import Path

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.io.motions.amass import read_amass
from vip_factors.io.motions.bvh import read_bvh

__all__ = ["MOTION_SUFFIXES", "motion_files", "read_amass", "read_bvh", "read_motion"]

READERS: dict[str, Callable[[Path], Motion]] = {".bvh": read_bvh, ".npz": read_amass}
MOTION_SUFFIXES = tuple(READERS)


def read_motion(path: str | Path) -> Motion:
    """A motion file of any known kind on our skeleton, Z up, metres.

    Raises:
        InputError: for an unknown suffix.
        FileFormatError: for a malformed file.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: expected a motion as BVH (.bvh) or AMASS (.npz)")
    return reader(path)


def motion_files(folder: str | Path) -> list[Path]:
    """All motion files in a folder and below, sorted; AMASS's files of a shape without a motion are not among them."""
    found = (path for path in Path(folder).rglob("*") if path.suffix.lower() in MOTION_SUFFIXES)
    return sorted(path for path in found if not (path.suffix == ".npz" and path.stem.endswith(("shape", "stagei"))))
