"""The faults of streams as a table, and as JSON."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from tests.studies.stream_faults import Errors, FaultTrial, KilledTrial, StreamResults, StreamTrials
from tests.studies.study import plain

HEAD = (
    "fault", "newest: before", "during", "after", "smoothed: before", "during", "after", "newest good after s",
    "smoothed good after s", "bad s", "place at end cm", "frames missing", "oldest answer s",
)  # fmt: skip


def stream_fault_table(results: StreamResults, trials: StreamTrials) -> str:
    """Markdown: a table for each stream, and what was said below it."""
    blocks = [
        f"MPJPE mm of one wearer's stream of {trials.seconds:g} s; faults from {trials.fault_s:g} s on; in brackets "
        "the same stream without the fault.\n'Good after': until the first second whose mean error is at most 1.2 "
        "times the undisturbed stream's, from the end of the fault, or from its beginning if it lasts. 'Bad': "
        "how many seconds of smoothed poses in all are not so, from the beginning of the fault on."
    ]
    streams = list(
        dict.fromkeys(
            [(one.clip, one.camera) for one in results.trials] + [(one.clip, one.camera) for one in results.killed]
        )
    )
    for clip, camera in streams:
        own = [one for one in results.trials if (one.clip, one.camera) == (clip, camera)]
        blocks.append(f"## {clip}, {camera} camera")
        if own:
            blocks += [_table(own), _said(own)]
        blocks += [_kill_line(one) for one in results.killed if (one.clip, one.camera) == (clip, camera)]
    return "\n\n".join(block for block in blocks if block) + "\n"


def stream_fault_json(results: StreamResults, trials: StreamTrials) -> str:
    """Every number, second by second, and the settings."""
    return json.dumps(plain(asdict(results) | {"settings": asdict(trials)}), indent=2) + "\n"


def _table(trials: Sequence[FaultTrial]) -> str:
    lines = [f"| {' | '.join(HEAD)} |", "|---|" + "---:|" * (len(HEAD) - 1)]
    for one in trials:
        if one.failure:
            lines.append(f"| {one.fault} | failed: {one.failure} |" + " |" * (len(HEAD) - 2))
            continue
        cells = [
            one.fault, *_errors(one.newest, one.usual_newest), *_errors(one.smoothed, one.usual_smoothed),
            _seconds(one.good_newest_s), _seconds(one.good_smoothed_s), f"{one.bad_smoothed_s:.1f}",
            f"{_number(one.place_cm[0])} ({_number(one.place_cm[1])})", str(one.missing), f"{one.latency_s:.2f}",
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _errors(errors: Errors, usual: Errors) -> list[str]:
    pairs = ((errors.before, usual.before), (errors.during, usual.during), (errors.after, usual.after))
    return [
        _number(ours) if n == 0 else f"{_number(ours)} ({_number(theirs)})" for n, (ours, theirs) in enumerate(pairs)
    ]


def _said(trials: Sequence[FaultTrial]) -> str:
    lines = []
    for one in trials:
        shift = f" (the stream's clock is {one.clock_shift_s:.2f} s behind from then on)" if one.clock_shift_s else ""
        lines.append(f"- {one.fault}{shift}: " + ("" if one.findings else "nothing was said"))
        times = Counter(sentence for _, sentence in one.findings)
        first = {sentence: time for time, sentence in reversed(one.findings)}
        for sentence, count in times.items():
            often = f" ({count} times)" if count > 1 else ""
            lines.append(f"  - {first[sentence]:.1f} s: {sentence}{often}")
    return "\n".join(lines)


def _kill_line(trial: KilledTrial) -> str:
    if not trial.kills:
        return "Killed while it wrote: nothing could be read"
    lost = [one.lost_s for one in trial.kills]
    return (
        f"Killed while it wrote, {len(lost)} times: {np.min(lost):.2f} to {np.max(lost):.2f} s of smoothed poses lost, "
        f"{min(one.readable for one in trial.kills)} frames or more could be read"
    )


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"


def _seconds(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "not to the end"
