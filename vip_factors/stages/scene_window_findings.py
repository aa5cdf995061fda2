"""Sentences on windows of one scene, each told once: with its first window, and how many others say the same."""

import re
from collections.abc import Sequence

# A name in quotes, or a number that stands by itself: digits of names without quotes touch other characters.
_NAME_OR_NUMBER = re.compile(r"(?P<name>(?<!\w)'.*?'(?!\w))|(?<![^\s(])[+-]?\d+(?:\.\d+)?(?:, \d+(?:\.\d+)?)*(?![\w-])")


class GatheredFindings:
    """Sentences are the same if they differ by numbers alone, none of which is in a name.

    Args:
        known: what is told of the whole already: windows need not say it again.
    """

    def __init__(self, known: Sequence[str] = ()) -> None:
        self._known = list(known)
        self._kinds = {_kind(sentence) for sentence in known}
        self._found: dict[str, tuple[str, float, float]] = {}
        self._again: dict[str, int] = {}

    def add(self, sentences: Sequence[str], start: float, end: float) -> None:
        """Those on a window from one instant to another, seconds."""
        for kind, sentence in {_kind(one): one for one in reversed(sentences)}.items():
            if kind in self._found:
                self._again[kind] += 1
            elif kind not in self._kinds:
                self._found[kind], self._again[kind] = (sentence, start, end), 0

    def sentences(self) -> tuple[str, ...]:
        """All of them."""
        return (*self._known, *(self._told(kind) for kind in self._found))

    def _told(self, kind: str) -> str:
        (sentence, start, end), again = self._found[kind], self._again[kind]
        more = f", and in {again} more windows" if again else ""
        return f"{sentence} (from {start:.0f} to {end:.0f} s{more})"


def _kind(sentence: str) -> str:
    return _NAME_OR_NUMBER.sub(lambda found: found["name"] or "#", sentence)
