"""How the package's objects show themselves: a few lines in a terminal, a small table in a notebook."""

from html import escape


class Summarised:
    """What tells of itself by lines, instead of by all its arrays: a title, then ``label: value`` each."""

    def summary(self) -> list[str]:
        """The lines, without indents."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n  ".join(self.summary())

    def _repr_html_(self) -> str:
        title, *lines = self.summary()
        rows = (line.partition(": ") for line in lines)
        cells = "".join(f"<tr><th>{escape(label)}</th><td>{escape(value)}</td></tr>" for label, _, value in rows)
        return f"<table><caption>{escape(title)}</caption>{cells}</table>"
