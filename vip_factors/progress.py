"""Progress of work in stages, for whoever shows it."""

from collections.abc import Callable

ProgressCallback = Callable[[str, float], None]
"""Called with the name of a stage and the fraction of it that is done."""


def silent(stage: str, fraction: float) -> None:
    """Progress that nobody looks at; unlike a lambda, it may be sent to another process."""
