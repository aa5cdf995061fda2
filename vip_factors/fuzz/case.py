"""A format that is put to the test: small whole files of it, how they are damaged, and what reads them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from vip_factors.fuzz.bytes_and_text import Mutation, mutated_bytes, mutated_text
from vip_factors.fuzz.containers import (
    mutated_json,
    mutated_mat,
    mutated_mcap,
    mutated_npz,
    mutated_pickle,
    mutated_stream,
)

MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    ".mcap": (mutated_mcap, mutated_mcap, mutated_mcap, mutated_bytes),
    ".messages": (mutated_stream, mutated_stream, mutated_bytes),
    ".json": (mutated_json, mutated_json, mutated_text),
    ".npz": (mutated_npz, mutated_npz, mutated_npz, mutated_bytes),
    ".pkl": (mutated_pickle, mutated_pickle, mutated_bytes),
    ".mat": (mutated_mat, mutated_mat, mutated_bytes),
}
"""By the suffix of a file; all others are text."""

Files = Mapping[str, bytes]
"""Content by name, with ``/`` between folders."""


@dataclass(frozen=True)
class Case:
    """One format.

    Attributes:
        name: of the format, as ``--formats`` takes it.
        files: whole ones, small, all of which are read.
        read: what the commands do with them, short of solving; gets their folder.
        command: with which a person repeats it; ``{}`` stands for the folder.
        sound: names of files that are not damaged.
        seldom: takes its turn in one round of so many, where reading takes long.
    """

    name: str
    files: Files
    read: Callable[[Path], object]
    command: str
    sound: tuple[str, ...] = ()
    seldom: int = 1

    @property
    def damageable(self) -> list[str]:
        """Names of the files that are damaged, one at a time."""
        return sorted(name for name in self.files if name not in self.sound)


def mutations_of(name: str) -> tuple[Mutation, ...]:
    """How a file of that name is damaged."""
    return MUTATIONS.get(Path(name).suffix, (mutated_text,))


def files_below(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {str(one.relative_to(folder)): one.read_bytes() for one in sorted(folder.rglob("*")) if one.is_file()}
