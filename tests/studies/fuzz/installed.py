"""Formats of which a library is missing are left out."""

from importlib.util import find_spec


def installed(*names: str) -> bool:
    """Whether all these packages can be imported."""
    return all(find_spec(name) is not None for name in names)
