"""Stretches of frames evaluated side by side: NumPy lets go of the interpreter while it multiplies."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

THREADS = min(4, os.cpu_count() or 1)  # beyond four the interpreter's own share is what takes the time


Stretch = TypeVar("Stretch")


def side_by_side(work: Callable[[Stretch], None], stretches: Sequence[Stretch]) -> None:
    """Do the work for each stretch of frames, in threads; stretches write to places of their own."""
    if len(stretches) < 2 or THREADS < 2:
        for stretch in stretches:
            work(stretch)
        return
    with ThreadPoolExecutor(min(THREADS, len(stretches))) as pool:
        list(pool.map(work, stretches))  # the list raises what a stretch raised
