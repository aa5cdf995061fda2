"""Files here or elsewhere: plain paths, and what fsspec reaches by a URL (``s3://bucket/walk.mcap``)."""

import glob
import os
import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError

# Of these a file appears only once it is whole; elsewhere it is put under another name, and renamed.
WHOLE = ("s3", "s3a", "gs", "gcs", "az", "abfs", "adl")


@dataclass(frozen=True)
class Storage:
    """A file, a folder or a glob on this machine, or on a disk that all share.

    Attributes:
        path: as it was given.
    """

    path: str

    def exists(self) -> bool:
        """Whether there is such a file or folder."""
        return os.path.exists(self.path)

    def is_folder(self) -> bool:
        """Whether it is a folder."""
        return os.path.isdir(self.path)

    def files(self) -> list[str]:
        """All files below the folder, sorted."""
        return sorted(os.path.join(top, name) for top, _, names in os.walk(self.path) for name in names)

    def glob(self) -> list[str]:
        """The files that the pattern meets, sorted."""
        return sorted(one for one in glob.glob(self.path, recursive=True) if os.path.isfile(one))

    def fetched(self, folder: Path) -> Path:
        """The file here, in a folder of ours if it was elsewhere."""
        return Path(self.path)

    def put(self, made: Path) -> None:
        """Have a file of ours under this name, whole or not at all."""
        os.makedirs(os.path.dirname(self.path) or ".", exist_ok=True)
        with atomic_path(self.path, overwrite=True) as part:
            shutil.copyfile(made, part)


@dataclass(frozen=True)
class _Elsewhere(Storage):
    """The same behind a URL, which is the path.

    Attributes:
        system: of fsspec.
        inner: path within that.
    """

    system: Any
    inner: str

    def exists(self) -> bool:
        return bool(self.system.exists(self.inner))

    def is_folder(self) -> bool:
        return bool(self.system.isdir(self.inner))

    def files(self) -> list[str]:
        return [self.system.unstrip_protocol(one) for one in sorted(self.system.find(self.inner))]

    def glob(self) -> list[str]:
        return [self.system.unstrip_protocol(one) for one in sorted(self.system.glob(self.inner))]

    def fetched(self, folder: Path) -> Path:
        here = folder / PurePosixPath(self.inner).name
        try:
            self.system.get_file(self.inner, str(here))
        except FileNotFoundError as error:
            raise InputError(f"{self.path}: there is no such file") from error
        return here

    def put(self, made: Path) -> None:
        if self.path.partition("://")[0] in WHOLE:
            self.system.put_file(str(made), self.inner)
            return
        self.system.makedirs(self.inner.rpartition("/")[0], exist_ok=True)
        part = f"{self.inner}.{secrets.token_hex(4)}.part"
        self.system.put_file(str(made), part)
        self.system.mv(part, self.inner)


def storage_of(path: str) -> Storage:
    """Where a path is.

    Raises:
        InputError: for a URL without fsspec, or of a kind that it cannot reach as it is installed.
    """
    if "://" not in path:
        return Storage(path)
    try:
        from fsspec.core import url_to_fs

        system, inner = url_to_fs(path, use_listings_cache=False)
    except (ImportError, ValueError) as error:
        raise InputError(f"{path}: pip install 'vip-factors[cluster]' reads files elsewhere ({error})") from error
    return _Elsewhere(path, system, inner)
