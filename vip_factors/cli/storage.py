"""Files here or elsewhere: plain paths, and URLs that fsspec reaches (``s3://bucket/walk.mcap``)."""

import os
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from vip_factors.atomic import atomic_path
from vip_factors.errors import InputError, VipFactorsError

GLOB = re.compile(r"[*?\[]")
STREAMS = ("ws", "wss")  # :// of a stream that is no file
RECORDING = re.compile(r"(?!\.).*(?<!\.estimate)(?<!\.partial)\.mcap")


def is_url(word: str) -> bool:
    """Whether a word names a file elsewhere."""
    scheme, mark, _ = word.partition("://")
    return bool(mark) and scheme not in STREAMS


def is_several(word: str) -> bool:
    """Whether a word names a folder, a glob or a file elsewhere: no plain file."""
    return is_url(word) or os.path.isdir(word) or (bool(GLOB.search(word)) and not os.path.exists(word))


def location(text: str) -> Path:
    """A path, or a ``UPath``, which has the same methods, behind a URL.

    Raises:
        InputError: for a URL without fsspec, or of a kind that it cannot reach as it is installed.
    """
    if not is_url(text):
        return Path(text)
    try:
        from fsspec import get_filesystem_class
        from upath import UPath

        get_filesystem_class(text.partition("://")[0])  # UPath takes an unknown kind of URL for a path
        path: Any = UPath(text, use_listings_cache=False)
        path.fs  # noqa: B018 - imports the package of this kind of URL
    except (ImportError, ValueError) as error:
        raise InputError(f"{text}: pip install 'vip-factors[cluster]' reads files elsewhere ({error})") from error
    return cast(Path, path)


@contextmanager
def reaching(path: object) -> Iterator[None]:
    """Turn what the library behind a URL raises into one sentence.

    Raises:
        InputError: naming the path.
    """
    try:
        yield
    except (VipFactorsError, OSError):
        raise
    except Exception as error:  # its class is known to a library that may not be installed
        sentence = " ".join(str(error).split())
        raise InputError(f"{path} cannot be reached: {sentence} ({type(error).__name__})") from error


def recordings(words: Sequence[str]) -> Iterator[tuple[Path, Path]]:
    """Recordings that folders, globs and names stand for.

    Yields:
        The file, and the folder below which its output keeps its place.

    Raises:
        InputError: if a location cannot be reached.
    """
    for word in words:
        with reaching(word):
            path, star = location(word), GLOB.search(word)
            if star and not path.exists():
                start = word[: star.start()].rfind("/") + 1
                root, pattern = location(word[:start] or "."), word[start:]
            elif path.is_dir():
                root, pattern = path, "**/*.mcap"
            else:  # a file that is not there fails when its turn comes
                yield path, path.parent
                continue
            yield from ((file, root) for file in sorted(root.glob(pattern)) if RECORDING.fullmatch(file.name))


def fetched(path: Any, folder: Path) -> Path:
    """The file itself, or a copy in ``folder`` of one that is elsewhere."""
    if isinstance(path, Path):
        return path
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    path.fs.get_file(path.path, str(folder / path.name))
    return folder / str(path.name)


def put(file: Path, path: Any) -> None:
    """Copy a file to its place, whole or not at all, as object stores do it."""
    if isinstance(path, Path):
        os.makedirs(path.parent, exist_ok=True)
        with atomic_path(path, overwrite=True) as part:
            shutil.copyfile(file, part)
    else:
        path.fs.put_file(str(file), path.path)
