"""A format that is put to the test: small whole files of it, how they are damaged, and what reads them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.studies.fuzz.bytes_and_text import Mutation, mutated_bytes, mutated_text
from tests.studies.fuzz.containers import (
    mutated_json,
    mutated_mcap,
    mutated_npz,
    mutated_pickle,
    mutated_protobuf,
    mutated_stream,
)
from vip_factors.body.kinematics import Motion

MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    ".mcap": (mutated_mcap, mutated_mcap, mutated_mcap, mutated_bytes),
    ".messages": (mutated_stream, mutated_stream, mutated_bytes),
    ".json": (mutated_json, mutated_json, mutated_text),
    ".npz": (mutated_npz, mutated_npz, mutated_npz, mutated_bytes),
    ".pkl": (mutated_pickle, mutated_pickle, mutated_bytes),
    ".onnx": (mutated_protobuf, mutated_protobuf, mutated_bytes),
    **dict.fromkeys((".mp4", ".png", ".jpg", ".tflite", ".whl", ".db"), (mutated_bytes,)),
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
        seldom: how many times as seldom as others it is damaged, where reading takes long.
        apart: read in a process of its own, as native libraries read it that may crash.
    """

    name: str
    files: Files
    read: Callable[[Path], object]
    command: str
    sound: tuple[str, ...] = ()
    seldom: int = 1
    apart: bool = False

    @property
    def damageable(self) -> list[str]:
        """Names of the files that are damaged, one at a time."""
        return sorted(name for name in self.files if name not in self.sound)


def command_case(
    name: str, files: Files, *lines: str, sound: tuple[str, ...] = (), seldom: int = 1, apart: bool = False
) -> Case:
    """A case that is read by whole commands, one after another; ``{}`` stands for the folder."""

    def read(folder: Path) -> None:
        for line in lines:
            command, *words = line.replace("{}", str(folder)).split(" ")
            run_command(command, words)

    return Case(name, files, read, " && ".join(f"vip-factors {line}" for line in lines), sound, seldom, apart)


def run_command(command: str, words: Sequence[str]) -> None:
    """A command, without the lines that it prints; what a user can mend is raised."""
    module = import_module(f"vip_factors.cli.{command.replace('-', '_')}")
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        module.main(f"vip-factors {command}", words)


def installed(name: str) -> bool:
    """Whether a package can be imported: formats of which a library is missing are left out."""
    return find_spec(name) is not None


def mutations_of(name: str) -> tuple[Mutation, ...]:
    """How a file of that name is damaged."""
    return MUTATIONS.get(Path(name).suffix, (mutated_text,))


def files_below(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {str(one.relative_to(folder)): one.read_bytes() for one in sorted(folder.rglob("*")) if one.is_file()}


def written(write: Callable[[Path], object]) -> dict[str, bytes]:
    """All files that something writes into a folder."""
    with TemporaryDirectory() as name:
        write(Path(name))
        return files_below(Path(name))


def written_motions(motion: Motion) -> dict[str, bytes]:
    """A motion as the files of other programs: a.bvh, a.npz."""
    from vip_factors.estimate import Estimate, WearerEstimate
    from vip_factors.io.export.animation import write_bvh
    from vip_factors.io.export.files import ExportSettings
    from vip_factors.io.export.smpl import write_amass

    estimate = Estimate("a", "IT", (WearerEstimate("a", "IT", motion, {}),))

    def write(folder: Path) -> None:
        write_bvh(estimate, folder / "a.bvh", ExportSettings())
        write_amass(estimate, folder / "a.npz", ExportSettings())

    return written(write)
