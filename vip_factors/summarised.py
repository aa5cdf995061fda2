"""How the package's objects show themselves: a few lines in a terminal, a small table in a notebook."""

import re
from html import escape


class Summarised:
    """What tells of itself by lines, not by all its arrays: a title, then ``label: value`` or ``label  value`` each."""

    def summary(self) -> list[str]:
        """The lines, without indents."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n  ".join(self.summary())

    def _repr_html_(self) -> str:
        title, *lines = self.summary()
        rows = (re.match("(.*?)(?:: +|  +|$)(.*)", escape(line)) for line in lines)
        cells = "".join(f"<tr><th>{row[1]}</th><td>{row[2]}</td></tr>" for row in rows if row)
        return f"<table><caption>{escape(title)}</caption>{cells}</table>"
