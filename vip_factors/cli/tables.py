"""Tables of facts on a terminal, by Rich."""

import shutil
import sys
from collections.abc import Iterable
from io import StringIO

from vip_factors.cli.terminal import printable, say
from vip_factors.describe.table import Table


def print_tables(tables: Iterable[Table]) -> None:
    """Print the tables, as wide as the terminal is; where stdout is none, no line is broken."""
    say(terminal_text(tables, shutil.get_terminal_size().columns if sys.stdout.isatty() else None))


def terminal_text(tables: Iterable[Table], width: int | None = None) -> str:
    """Tables below each other as plain text, those without rows left out; ``width`` in characters."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.table import Table as Grid

    texts = []
    for table in tables:
        if not table.rows:
            continue
        grid = Grid(box=None, show_header=bool(table.head), padding=(0, 2, 0, 0), pad_edge=False)
        for column, name in enumerate(table.head or ("", "")):
            is_label = not table.head and column == 0
            grid.add_column(
                printable(name), justify="left" if column < table.words else "right", no_wrap=is_label, overflow="fold"
            )
        for row in table.rows:
            cells = [printable(str(cell)) for cell in row]
            grid.add_row(*cells if table.head else (f"{cells[0]}:", *cells[1:]))
        text = StringIO()
        Console(file=text, width=width or 1000, color_system=None, markup=False, emoji=False).print(
            Padding(grid, (0, 0, 0, 2))
        )
        lines = [line.rstrip() for line in text.getvalue().splitlines()]
        texts.append("\n".join([printable(table.title), *lines] if table.title else lines))
    return "\n\n".join(texts)
