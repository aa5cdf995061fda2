"""Files here or elsewhere: plain paths, and what fsspec reaches by a URL (``s3://bucket/walk.mcap``)."""

import glob
import os
import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError

# Of these a file appears only once it is whole; elsewhere it is put under another name, and renamed.
WHOLE = ("s3", "s3a", "gs", "gcs", "az", "abfs", "adl")


class Storage(Protocol):
    """A file, a folder or a glob."""

    def exists(self) -> bool:
        """Whether there is such a file or folder."""
        ...

    def is_folder(self) -> bool:
        """Whether it is a folder."""
        ...

    def files(self) -> list[str]:
        """All files below the folder, sorted."""
        ...

    def glob(self) -> list[str]:
        """The files that the pattern meets, sorted."""
        ...

    def fetched(self, folder: Path) -> Path:
        """The file here, in a folder of ours if it was elsewhere."""
        ...

    def put(self, made: Path) -> None:
        """Have a file of ours under this name, whole or not at all."""
        ...


@dataclass(frozen=True)
class _Here:
    """On this machine, or a disk that all share."""

    path: str

    def exists(self) -> bool:
        return os.path.exists(self.path)

    def is_folder(self) -> bool:
        return os.path.isdir(self.path)

    def files(self) -> list[str]:
        return sorted(os.path.join(top, name) for top, _, names in os.walk(self.path) for name in names)

    def glob(self) -> list[str]:
        return sorted(one for one in glob.glob(self.path, recursive=True) if os.path.isfile(one))

    def fetched(self, folder: Path) -> Path:
        return Path(self.path)

    def put(self, made: Path) -> None:
        os.makedirs(os.path.dirname(self.path) or ".", exist_ok=True)
        with atomic_path(self.path, overwrite=True) as part:
            shutil.copyfile(made, part)


@dataclass(frozen=True)
class _Elsewhere:
    """Behind a URL.

    Attributes:
        url: of it.
        system: of fsspec.
        path: within that.
    """

    url: str
    system: Any
    path: str

    def exists(self) -> bool:
        return bool(self.system.exists(self.path))

    def is_folder(self) -> bool:
        return bool(self.system.isdir(self.path))

    def files(self) -> list[str]:
        return [self.system.unstrip_protocol(one) for one in sorted(self.system.find(self.path))]

    def glob(self) -> list[str]:
        return [self.system.unstrip_protocol(one) for one in sorted(self.system.glob(self.path))]

    def fetched(self, folder: Path) -> Path:
        here = folder / PurePosixPath(self.path).name
        try:
            self.system.get_file(self.path, str(here))
        except FileNotFoundError as error:
            raise InputError(f"{self.url}: there is no such file") from error
        return here

    def put(self, made: Path) -> None:
        if self.url.partition("://")[0] in WHOLE:
            self.system.put_file(str(made), self.path)
            return
        self.system.makedirs(self.path.rpartition("/")[0], exist_ok=True)
        part = f"{self.path}.{secrets.token_hex(4)}.part"
        self.system.put_file(str(made), part)
        self.system.mv(part, self.path)


def storage_of(path: str) -> Storage:
    """Where a path is.

    Raises:
        InputError: for a URL without fsspec, or of a kind that it cannot reach as it is installed.
    """
    if "://" not in path:
        return _Here(path)
    try:
        from fsspec.core import url_to_fs

        system, inner = url_to_fs(path, use_listings_cache=False)
    except (ImportError, ValueError) as error:
        raise InputError(f"{path}: pip install 'vip-factors[cluster]' reads files elsewhere ({error})") from error
    return _Elsewhere(path, system, inner)
