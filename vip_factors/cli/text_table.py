"""Tables in plain text."""

from collections.abc import Sequence

import numpy as np


def aligned(rows: Sequence[Sequence[str]], left: int) -> list[str]:
    """Rows of as many cells each, as lines; the first ``left`` columns begin at their left, the others end right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if column < left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def with_sigma(value: float, sigma: float, decimals: int = 0, sigma_decimals: int = 1) -> str:
    """A value and its standard deviation, which is left out if it is not finite."""
    known = f" ± {sigma:.{sigma_decimals}f}" if np.isfinite(sigma) else ""
    return f"{value:z.{decimals}f}{known}"
