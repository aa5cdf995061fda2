"""Logs in zip archives, as phones share them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import BadZipFile, ZipFile

from vip_factors.errors import FileFormatError, InputError


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The folder that a zip archive holds, while the context lasts; any other path as it is.

    Raises:
        FileFormatError: if the archive cannot be unpacked.
    """
    if path.suffix.lower() != ".zip" or not path.is_file():
        yield path
        return
    with TemporaryDirectory() as place:
        folder = Path(place) / path.stem
        try:
            with ZipFile(path) as archive:
                archive.extractall(folder)
        except (BadZipFile, NotImplementedError, OSError, RuntimeError) as error:  # the last: a password is needed
            raise FileFormatError(f"{path}: cannot be unpacked ({error}): expected a zip archive of a log") from error
        inside = _visible(folder)
        while len(inside) == 1 and inside[0].is_dir():
            folder, inside = inside[0], _visible(inside[0])
        try:
            yield inside[0] if len(inside) == 1 else folder
        except InputError as error:
            raise type(error)(str(error).replace(f"{folder}", f"{path}")) from error


def _visible(folder: Path) -> list[Path]:
    return [inside for inside in folder.iterdir() if not inside.name.startswith((".", "__MACOSX"))]
