"""Findings about a recording or its estimate, as data: a kind, a subject and numbers.

Text is made where it is shown, from the one table of kinds: the sentence for whoever knows the method, and for
everybody what was found in a few words, what that means for the use of the results, and what to do.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path

import msgspec

TEXT = "text"  # the kind of a bare sentence: from a file of an older version, or of a stream's source


class Severity(StrEnum):
    """Severity of a finding for the use of the results, in ascending order; GOOD applies to results only."""

    GOOD = "good"
    NOTE = "note"
    CARE = "care"
    DOUBT = "doubt"

    def reaches(self, other: "Severity") -> bool:
        """Whether it is at least as severe as another."""
        order = list(Severity)
        return order.index(self) >= order.index(other)


@dataclass(frozen=True)
class Kind:
    """Properties that all findings of a kind share.

    Attributes:
        severity: how much they bear on the results.
        sentence: with the names and numbers of a finding in braces; ``{each}`` is a list of its numbers. The wearer's
            and the camera's names are put before it.
        headline: what is wrong, in a few words.
        affects: what it means for the use of the results.
        advice: what to do.
        each: format of a number in that list, by its ``name`` and ``value``.
        is_fault: whether something may be wrong; otherwise the set-up limits the accuracy.
    """

    severity: Severity
    sentence: str
    headline: str
    affects: str
    advice: str
    each: str = "{name}"
    is_fault: bool = True


@dataclass(frozen=True)
class Finding:
    """Message for the user; its text is the sentence.

    Attributes:
        kind: a name in :data:`KINDS`.
        wearer: name of the wearer it is about, if it is about one.
        camera: name of the camera in whose picture it was found, where there are several.
        subject: the sensor, joint, camera … it is about.
        numbers: by the names that the sentence has for them, or by what they were measured on; SI units, or as the
            names say.
        words: parts of the sentence that are no numbers.
        during: seconds of the window from which and until when it was found, in a recording solved in windows.
        more_windows: in which the same was found.
        text: the sentence itself, of one that was read from a file.
    """

    kind: str
    wearer: str = ""
    camera: str = ""
    subject: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    during: tuple[float, float] | None = None
    more_windows: int = 0
    text: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"'{self.kind}' is no kind of finding")

    @property
    def about(self) -> tuple[str, str, str, str]:
        """Kind, wearer, camera and subject: findings that agree in these are reported once."""
        return self.kind, self.wearer, self.camera, self.subject or self.text

    def __hash__(self) -> int:
        return hash(self.about)

    @property
    def severity(self) -> Severity:
        """Severity of the finding for the results."""
        return KINDS[self.kind].severity

    def __str__(self) -> str:
        if self.text:
            return self.text
        kind = KINDS[self.kind]
        values = ", ".join(kind.each.format(name=name, value=value) for name, value in self.numbers.items())
        names = {"subject": self.subject, "each": values, "count": len(self.numbers)}
        sentence = kind.sentence.format(**{**self.numbers, **self.words, **names})
        if self.wearer:
            sentence = f"wearer '{self.wearer}': {sentence}"
        if self.camera:
            sentence = f"camera '{self.camera}': {sentence}"
        if self.during is not None:
            windows = f", and in {self.more_windows} more windows" if self.more_windows else ""
            sentence += f" (from {self.during[0]:.0f} to {self.during[1]:.0f} s{windows})"
        return sentence


def bare(sentence: str, kind: str = TEXT) -> Finding:
    """Make a finding from its sentence alone; an unknown kind becomes :data:`TEXT`."""
    return Finding(kind if sentence and kind in KINDS else TEXT, text=sentence)


def sentences(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the findings as sentences of text."""
    return tuple(map(str, findings))


VERDICTS = {
    Severity.GOOD: "no problem was found",
    Severity.CARE: "usable with care",
    Severity.DOUBT: "do not rely on these results before this is resolved",
}


@dataclass(frozen=True)
class Verdict:
    """Reliability of an estimate, as terminal, report, viewers, JSON and exit codes show it.

    Attributes:
        severity: GOOD, CARE or DOUBT.
        deciding: headlines of the findings with this severity.
    """

    severity: Severity
    deciding: tuple[str, ...] = ()

    def __str__(self) -> str:
        text = f"{self.severity.upper()}, {VERDICTS[self.severity]}"
        return f"{text}: {'; '.join(self.deciding)}" if self.deciding else text


def verdict(findings: Iterable[Finding]) -> Verdict:
    """Verdict from the most severe of the findings; notes do not count."""
    weighty = [finding for finding in findings if finding.severity.reaches(Severity.CARE)]
    severity = Severity.DOUBT if any(finding.severity is Severity.DOUBT for finding in weighty) else Severity.CARE
    deciding = dict.fromkeys(KINDS[finding.kind].headline for finding in weighty if finding.severity is severity)
    return Verdict(severity, tuple(deciding)) if weighty else Verdict(Severity.GOOD)


MOST_WAITING = 1000  # findings in a log; new ones beyond are dropped, so that memory stays bounded


@dataclass
class _Tally:
    finding: Callable[[int], Finding]  # made from the count since the last report
    count: int = 0
    reported: float = -math.inf  # s, of the last report
    reports: int = 0
    due: float = math.inf  # s, of the next report


class FindingLog:
    """Queue of findings; repeated ones, also those of many windows, are counted and reported at intervals.

    Memory stays bounded as long as the keys do.

    Args:
        repeat_after: seconds between two reports of a key.
    """

    def __init__(self, repeat_after: float = math.inf) -> None:
        self._repeat_after = repeat_after
        self._tallies: dict[Hashable, _Tally] = {}
        self._waiting: list[Finding] = []

    def add(self, finding: Finding) -> None:
        """Add a finding to the log."""
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append(finding)

    def tally(
        self, key: Hashable, now: float, finding: Callable[[int], Finding], wait: float = 0.0, often: int = 1
    ) -> None:
        """Count an event of ``key``, and report ``finding(count)`` when it is due.

        Args:
            key: of the repeated event.
            now: seconds.
            finding: makes the finding from the count since the last report; that of the first event is used.
            wait: seconds to collect more events of the key; infinite: until :meth:`close`.
            often: reports after which ``repeat_after`` applies.
        """
        tally = self._tallies.setdefault(key, _Tally(finding))
        if not tally.count:
            next_report = tally.reported + self._repeat_after if tally.reports >= often else -math.inf
            tally.finding, tally.due = finding, max(now + wait, next_report)
        tally.count += 1
        if now >= tally.due:
            self._add(tally, now)

    def add_window(
        self, findings: Iterable[Finding], start: float, end: float, reported: Iterable[Finding] = ()
    ) -> None:
        """Add the findings of a window of a recording, from ``start`` to ``end`` (s).

        :meth:`close` reports each once, with its first window and the number of others. Findings ``reported`` for the
        whole recording are added only if the window has further numbers.
        """
        measured = {finding.about: finding.numbers.keys() for finding in reported}
        for subject, finding in {finding.about: replace(finding, during=(start, end)) for finding in findings}.items():
            if subject not in measured or not finding.numbers.keys() <= measured[subject]:
                in_windows = partial(lambda finding, count: replace(finding, more_windows=count - 1), finding)
                self.tally(subject, start, in_windows, wait=math.inf)

    def close(self) -> None:
        """Report all events that were only counted."""
        for tally in self._tallies.values():
            if tally.count:
                self._add(tally, tally.reported)

    def take(self, now: float = -math.inf) -> tuple[Finding, ...]:
        """Remove and return all findings in order, with those that are due."""
        for tally in self._tallies.values():
            if now >= tally.due:
                self._add(tally, now)
        findings = tuple(self._waiting)
        self._waiting.clear()
        return findings

    def _add(self, tally: _Tally, now: float) -> None:
        self.add(tally.finding(tally.count))
        tally.count, tally.reported, tally.due = 0, now, math.inf
        tally.reports += 1


KINDS = msgspec.toml.decode(Path(__file__).with_name("finding_kinds.toml").read_bytes(), type=dict[str, Kind])
