"""Tables of facts on a terminal, by Rich."""

import shutil
import sys
from collections.abc import Iterable
from io import StringIO

from vip_factors.cli.terminal import printable, say
from vip_factors.describe.table import Table

UNBROKEN = 10_000  # characters, where no terminal breaks lines


def print_tables(tables: Iterable[Table]) -> None:
    """Print the tables, as wide as the terminal is; where stdout is none, no line is broken."""
    say(terminal_text(tables, shutil.get_terminal_size().columns if sys.stdout.isatty() else UNBROKEN))


def terminal_text(tables: Iterable[Table], width: int = UNBROKEN) -> str:
    """Tables below each other as plain text, those without rows left out; ``width`` in characters."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.table import Table as Grid

    texts = []
    for table in filter(lambda table: table.rows, tables):
        rows = [[printable(str(cell)) for cell in row] for row in table.rows]
        if not table.head:
            rows = [[f"{label}:", *cells] for label, *cells in rows]
        grid = Grid(box=None, show_header=bool(table.head), padding=(0, 2, 0, 0), pad_edge=False)
        longest = max(len(row[0]) for row in rows)
        for column, name in enumerate(table.head or ("", "")):
            grid.add_column(
                printable(name),
                justify="left" if column < table.words else "right",
                no_wrap=column == 0 and longest <= width // 3,  # names stay whole; Rich cuts longer ones instead
                overflow="fold",
            )
        for row in rows:
            grid.add_row(*row)
        text = StringIO()
        console = Console(file=text, width=width, color_system=None, markup=False, emoji=False)
        console.print(Padding(grid, (0, 0, 0, 2)))
        lines = [line.rstrip() for line in text.getvalue().splitlines()]
        texts.append("\n".join([printable(table.title), *lines] if table.title else lines))
    return "\n\n".join(texts)
