"""What tuning found: a table for people, and a settings file that says where it comes from."""

from collections.abc import Mapping, Sequence

import numpy as np

from vip_factors.tune.leave_one_out import Errors, Judged, Trial, best, leave_one_out, loss
from vip_factors.tune.parameters import Parameter


def report_lines(trials: Sequence[Trial], parameters: Sequence[Parameter], before: Errors, unit: str) -> list[str]:
    """What was found, and what it is worth on recordings that it was not found on.

    Args:
        trials: of the study, the settings as they were first.
        parameters: what was tuned.
        before: errors with the settings as they were.
        unit: of the errors.
    """
    chosen = best(trials, before)
    lines = [f"{len(trials) - 1} trials on {len(before)} recordings; best is trial {chosen.number}"]
    width = max(len(one.name) for one in parameters)
    for one in parameters:
        lines.append(f"  {one.name:<{width}}  {trials[0].values[one.name]:8.4g} -> {chosen.values[one.name]:.4g}")
    if len(before) < 2:
        lines.append(f"{loss(chosen.errors, before):.3f} times the error before, on the recording it was tuned on")
        return [*lines, "one recording judges itself: give more to know what this is worth on another"]
    judged = leave_one_out(trials, before)
    lines += ["", *_table(judged, unit), "", verdict(judged)]
    return lines


def verdict(judged: Sequence[Judged]) -> str:
    """Whether settings carry over to a recording that they were not tuned on, in a sentence."""
    apparent = float(np.mean([one.fitted / one.before for one in judged]))
    honest = float(np.mean([one.after / one.before for one in judged]))
    worse = sum(one.after > one.before for one in judged)
    told = f"tuned on all: {apparent:.3f} times the error before; left out of the tuning: {honest:.3f} times"
    if honest >= 1.0:
        return f"{told}. It does not carry over to other recordings: keep the settings as they are"
    return f"{told}{f', worse on {worse} of {len(judged)}' if worse else ''}"


def _table(judged: Sequence[Judged], unit: str) -> list[str]:
    width = max(len("recording"), *(len(one.name) for one in judged))
    lines = [f"{'recording':<{width}}  {f'before, {unit}':>12}  {'tuned on all':>12}  {'left out':>12}  trial"]
    for one in judged:
        lines.append(f"{one.name:<{width}}  {one.before:12.3f}  {one.fitted:12.3f}  {one.after:12.3f}  {one.chosen:5d}")
    return lines


def settings_text(chosen: Trial, notes: Sequence[str]) -> str:
    """A settings file (TOML) of a trial's values, with the notes as comments before it."""
    lines = [*(f"# {note}".rstrip() for note in notes)]
    tables: dict[str, dict[str, float]] = {}
    for name, value in chosen.values.items():
        table, _, key = name.rpartition(".")
        tables.setdefault(table, {})[key] = value
    for table, values in sorted(tables.items()):  # keys of no table come first, as TOML wants them
        lines += ["", *([f"[{table}]"] if table else []), *_keys(values)]
    return "\n".join(lines) + "\n"


def _keys(values: Mapping[str, float]) -> list[str]:
    return [f"{key} = {value:.6g}" if value != int(value) else f"{key} = {int(value)}" for key, value in values.items()]
