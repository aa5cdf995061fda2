"""Findings in plain words: sentences of one kind together."""

from collections.abc import Sequence

from vip_factors.report.blocks import Remark
from vip_factors.report.finding_meanings import UNKNOWN, Meaning, meaning_of


def remarks_of(findings: Sequence[str]) -> list[Remark]:
    """A remark for every kind of finding there is, with the sentences themselves as its detail."""
    by_kind: dict[str, tuple[Meaning, list[str]]] = {}
    for sentence in findings:
        meaning = meaning_of(sentence)
        key = meaning.kind if meaning is not UNKNOWN else sentence
        by_kind.setdefault(key, (meaning, []))[1].append(sentence)
    return [
        Remark(meaning.weight, meaning.headline, meaning.means, meaning.advice, "; ".join(sentences))
        for meaning, sentences in by_kind.values()
    ]
