"""The trials of :mod:`tests.studies.kaichi` as tables beside the paper's, and as JSON."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict

import numpy as np

from tests.studies.kaichi import PUBLISHED_CM, PUBLISHED_DEG, Form, KaichiTrial, KaichiTrials, Way
from tests.studies.vip_table import plain
from vip_factors.evaluate.joints import GLOBAL_JOINTS

JUMPING = 0.03  # share of frames off the ground from which on a clip is one of those that the paper leaves out


def kaichi_table(results: Sequence[KaichiTrial], trials: KaichiTrials) -> str:
    """Markdown: errors per clip with all IMUs, where they lie, then errors with fewer IMUs."""
    most = max(one.imus for one in results)
    all_imus = [one for one in results if one.imus == most]
    title = (
        f"Global error in cm over 16 joints, nothing aligned (IMU only: the first frame's root and yaw), of {most} "
        f"IMUs and a standing camera of known pose; {trials.scenes.seconds:g} s after a T-pose. The mean leaves "
        "jumps out; published: TotalCapture, other motions"
    )
    blocks = [
        [title, "", *_clip_lines(all_imus, lambda one: one.error_cm, PUBLISHED_CM)],
        ["Orientation error in degrees of the same joints", "", *_clip_lines(all_imus, _degrees, PUBLISHED_DEG)],
        ["Errors of the root by direction in cm, and the rest", "", *_direction_lines(all_imus)],
        ["Errors by joint in cm, both sides", "", *_joint_lines(all_imus)],
    ]
    if len({one.imus for one in results}) > 1:
        blocks.append(["By the number of IMUs: cm / degrees", "", *_count_lines(results)])
    failures = [f"- {t.clip}, {t.imus} IMUs, {t.form}, {t.way}: {t.failure}" for t in results if t.failure]
    if failures:
        blocks.append(["No estimate, and left out of the means:", *failures])
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _degrees(one: KaichiTrial) -> float:
    return one.error_deg


def _rows(results: Sequence[KaichiTrial]) -> list[tuple[Form, Way, list[KaichiTrial]]]:
    """Trials by form and way, in the order of the paper's table."""
    rows = []
    for way in Way:
        for form in Form:
            own = [one for one in results if one.form is form and one.way is way]
            if own:
                rows.append((form, way, own))
    return rows


def jumping_clips(results: Sequence[KaichiTrial]) -> set[str]:
    """The clips in which both feet leave the ground for long."""
    return {one.clip for one in results if one.off_ground >= JUMPING}


def _clip_lines(
    results: Sequence[KaichiTrial], value: Callable[[KaichiTrial], float], published: dict[Form, float]
) -> list[str]:
    clips, jumps = list(dict.fromkeys(one.clip for one in results)), jumping_clips(results)
    names = [f"{clip} (jumps)" if clip in jumps else clip for clip in clips]
    lines = [
        f"| estimator | | {' | '.join(names)} | mean | published |",
        "|---|---|" + "---:|" * (len(clips) + 2),
    ]
    for form, way, own in _rows(results):
        cells = [_one(_mean(value(one) for one in own if one.clip == clip)) for clip in clips]
        mean = _one(_mean(value(one) for one in own if one.clip not in jumps))
        theirs = f"{published[form]:g}" if way in (Way.THEIRS, Way.THEIRS_LIVE) and form in published else ""
        lines.append(f"| {form} | {way} | {' | '.join(cells)} | {mean} | {theirs} |")
    return lines


def _direction_lines(results: Sequence[KaichiTrial]) -> list[str]:
    head = ["depth", "too far", "across", "up", "MPJPE mm", "CPU s"]
    lines = [f"| estimator | | {' | '.join(head)} |", "|---|---|" + "---:|" * len(head)]
    names = ("depth_cm", "depth_bias_cm", "across_cm", "up_cm", "mpjpe_mm", "cpu_s")
    for form, way, own in _rows(results):
        cells = [_one(_mean(getattr(one, name) for one in own)) for name in names]
        lines.append(f"| {form} | {way} | {' | '.join(cells)} |")
    return lines


def _joint_lines(results: Sequence[KaichiTrial]) -> list[str]:
    names = list(dict.fromkeys(name.removeprefix("left_").removeprefix("right_") for name in GLOBAL_JOINTS))
    lines = [f"| estimator | | {' | '.join(names)} |", "|---|---|" + "---:|" * len(names)]
    for form, way, own in _rows(results):
        cells = [
            _one(_mean(value for one in own for joint, value in one.joints_cm.items() if joint.endswith(name)))
            for name in names
        ]
        lines.append(f"| {form} | {way} | {' | '.join(cells)} |")
    return lines


def _count_lines(results: Sequence[KaichiTrial]) -> list[str]:
    counts, jumps = list(dict.fromkeys(one.imus for one in results)), jumping_clips(results)
    lines = [
        f"| estimator | | {' | '.join(f'{count} IMUs' for count in counts)} |",
        "|---|---|" + "---:|" * len(counts),
    ]
    for form, way, own in _rows(results):
        cells = []
        for count in counts:
            several = [one for one in own if one.imus == count and one.clip not in jumps]
            cells.append(f"{_one(_mean(t.error_cm for t in several))} / {_one(_mean(t.error_deg for t in several))}")
        lines.append(f"| {form} | {way} | {' | '.join(cells)} |")
    return lines


def _mean(values: Iterable[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def _one(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else ""


def kaichi_line(trial: KaichiTrial) -> str:
    """One trial on one line."""
    where = f"{trial.clip}, {trial.imus} IMUs, {trial.form}, {trial.way}"
    if trial.failure:
        return f"{where}: {trial.failure}"
    return (
        f"{where}: {trial.error_cm:.1f} cm {trial.error_deg:.1f} deg, depth {trial.depth_cm:.1f} cm, "
        f"MPJPE {trial.mpjpe_mm:.1f} mm, CPU {trial.cpu_s:.1f} s"
    )


def kaichi_json(results: Sequence[KaichiTrial], trials: KaichiTrials) -> str:
    """Every trial, what was published, and the settings; what is not defined is null."""
    content = {
        "published_cm": dict(PUBLISHED_CM),
        "published_deg": dict(PUBLISHED_DEG),
        "trials": [asdict(one) for one in results],
        "settings": asdict(trials),
    }
    return json.dumps(plain(content), indent=2) + "\n"
