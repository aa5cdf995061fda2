"""What tuning is worth on a recording that it has not seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError

Errors = Mapping[str, float]
"""Error of each recording, by name, in the unit of the measure."""


@dataclass(frozen=True)
class Trial:
    """Some settings, and how large the errors were with them.

    Attributes:
        number: in the study; 0 are the settings as they were.
        values: of the parameters.
        errors: of every recording.
    """

    number: int
    values: Mapping[str, float]
    errors: Errors


@dataclass(frozen=True)
class Judged:
    """A recording, judged by the trial that was best on all others.

    Attributes:
        name: of the recording.
        before: its error with the settings as they were.
        chosen: number of the trial that was best on the others.
        after: its error with that trial's settings.
        fitted: its error with the settings that were best on all, itself among them: what tuning seems to be worth.
    """

    name: str
    before: float
    chosen: int
    after: float
    fitted: float


def loss(errors: Errors, before: Errors, without: str | None = None) -> float:
    """Mean ratio of errors to those before: 1 is as good as it was, whatever a recording's size of error.

    Args:
        errors: with some settings.
        before: with the settings as they were.
        without: a recording to leave out.
    """
    return float(np.mean([errors[name] / before[name] for name in before if name != without]))


def best(trials: Sequence[Trial], before: Errors, without: str | None = None) -> Trial:
    """The trial of the least loss; of equals the first, so that nothing is changed for nothing."""
    return min(trials, key=lambda trial: loss(trial.errors, before, without))


def leave_one_out(trials: Sequence[Trial], before: Errors) -> tuple[Judged, ...]:
    """Every recording judged by what was best on the others.

    The trials themselves were drawn with all recordings in view, which favours tuning a little: a sampler that looks
    where errors were small leaves more trials there. Only recordings that no study ever saw tell more.

    Raises:
        InputError: for fewer than two recordings, or no trial.
    """
    if len(before) < 2 or not trials:
        raise InputError(f"{len(trials)} trials on {len(before)} recordings: to leave one out takes at least two")
    overall = best(trials, before)
    judged = []
    for name in before:
        chosen = best(trials, before, without=name)
        judged.append(Judged(name, before[name], chosen.number, chosen.errors[name], overall.errors[name]))
    return tuple(judged)
