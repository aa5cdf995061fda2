"""The trials of :mod:`tests.studies.sip` as a table beside the thesis's, and as JSON."""

import json
from collections.abc import Sequence
from dataclasses import asdict

from tests.studies.sip import VARIANTS, SipTrials, Trial, Variant, means_by_kind
from tests.studies.thesis import TRUE_POSE, ZERO_POSE

SOP_TRUE, SIP_TRUE = Variant("SOP", "true pose"), Variant("SIP", "true pose")


def sip_table(trials: Sequence[Trial], settings: SipTrials) -> str:
    """Markdown: every variant by kind of motion, what acceleration gains, and the thesis's figures below."""
    means = {variant: means_by_kind(trials, variant) for variant in VARIANTS}
    kinds = list(means[SIP_TRUE])
    recordings = len(trials) // len(VARIANTS)
    lines = [
        f"MPJPE mm / MPJAE deg of six simulated sensors, {recordings} recordings after a T-pose held with errors of "
        f"{settings.pose_error_deg:g} deg per joint and axis",
        "",
        f"| tracker | mountings from | {' | '.join(kinds)} |",
        "|---|---|" + "---:|" * len(kinds),
    ]
    for variant, row in means.items():
        cells = [_pair(row[kind]) for kind in kinds]
        lines.append(f"| {variant.method} | {variant.start} | {' | '.join(cells)} |")
    gains = [f"{-gain(means[SOP_TRUE][kind][0], means[SIP_TRUE][kind][0]):.0f} %" for kind in kinds]
    lines.append(f"| SIP against SOP, MPJPE | true pose | {' | '.join(gains)} |")
    return "\n".join([*lines, "", *_thesis_lines()]) + "\n"


def gain(before: float, after: float) -> float:
    """By how many percent an error fell."""
    return 100 * (1 - after / before)


def _thesis_lines() -> list[str]:
    kinds = list(TRUE_POSE["SIP"])
    lines = [
        "Thesis, on TotalCapture (other motions, real sensors; tables 3.3 to 3.5 and 4.9)",
        "",
        f"| tracker | mountings from | {' | '.join(kinds)} |",
        "|---|---|" + "---:|" * len(kinds),
    ]
    for start, table in (("true pose", TRUE_POSE), ("zero pose", ZERO_POSE)):
        for method, row in table.items():
            lines.append(f"| {method} | {start} | {' | '.join(_pair(row[k]) if k in row else '' for k in kinds)} |")
    gains = [f"{-gain(TRUE_POSE['SOP'][kind][0], TRUE_POSE['SIP'][kind][0]):.0f} %" for kind in kinds]
    lines.append(f"| SIP against SOP, MPJPE | true pose | {' | '.join(gains)} |")
    return lines


def _pair(errors: tuple[float, float]) -> str:
    return f"{errors[0]:.1f} / {errors[1]:.1f}"


def sip_json(trials: Sequence[Trial], settings: SipTrials) -> str:
    """Every trial, the means, and the settings they were made with."""
    means = [
        {**asdict(variant), "kinds": {k: {"mpjpe_mm": p, "mpjae_deg": a} for k, (p, a) in row.items()}}
        for variant in VARIANTS
        for row in [means_by_kind(trials, variant)]
    ]
    content = {"means": means, "trials": [asdict(trial) for trial in trials], "settings": asdict(settings)}
    return json.dumps(content, indent=2) + "\n"
