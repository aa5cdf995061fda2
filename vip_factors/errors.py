"""The exceptions of the package: one base, so that a caller can catch everything of ours at once.

Every message is one clear sentence: what was given, where, what was expected, and what to do.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class VipFactorsError(Exception):
    """Base of every error that vip_factors raises on purpose."""


class InputError(VipFactorsError, ValueError):
    """What the user gave cannot be used: a value, a name, a combination of options."""


class FileFormatError(InputError):
    """A file is not what it should be: truncated, malformed, of another format."""


class RecordingError(InputError):
    """The samples of a recording are unusable: time running backwards, NaN everywhere, no sensor left."""


class SolveError(VipFactorsError):
    """The optimiser could not proceed: an indeterminate system, a cost that is not finite."""


def nearest(word: str, choices: Iterable[str]) -> str:
    """The end of a complaint about an unknown word: the known word that is most alike, or all known ones."""
    from difflib import get_close_matches

    choices = list(choices)
    alike = get_close_matches(word.lower(), choices, 1, 0.5) or get_close_matches(word, choices, 1, 0.5)
    if alike:
        return f"; did you mean '{alike[0]}'?"
    return f": expected one of {', '.join(choices)}" if choices else ""


@contextmanager
def naming_file(path: str | os.PathLike[str], temporary: str | os.PathLike[str] | None = None) -> Iterator[None]:
    """Errors of writing that name no file (a full disk, say), or a temporary one, name this one instead.

    Args:
        path: as the user knows it.
        temporary: under which it is written.

    Raises:
        OSError: of the same number and kind.
    """
    try:
        yield
    except OSError as error:
        ours = error.filename is None or (temporary is not None and os.fspath(error.filename) == os.fspath(temporary))
        if error.errno is None or isinstance(error, ConnectionError) or not ours:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error
