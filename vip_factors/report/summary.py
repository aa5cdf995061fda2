"""Remarks of a report's first section: whether to trust the estimate, and how sure its angles are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.describe.estimates import LIMB_JOINTS, limb_sigma, mountings_are_held
from vip_factors.describe.table import degrees, joint_words
from vip_factors.findings import KINDS, TEXT, VERDICTS, Finding, Severity, sentences
from vip_factors.report.report_data import ReportData, ReportWearer


@dataclass(frozen=True)
class Remark:
    """A headline with its weight, what it means, what to do, and the method's own sentences."""

    weight: Severity
    headline: str
    meaning: str = ""
    advice: str = ""
    detail: str = ""


def finding_remarks(findings: Sequence[Finding]) -> list[Remark]:
    """A remark for every kind of finding there is, with the findings themselves as its detail."""
    kinds: dict[str, list[Finding]] = {}  # bare sentences each by itself
    for finding in findings:
        kinds.setdefault(finding.text if finding.kind == TEXT else finding.kind, []).append(finding)
    remarks = []
    for alike in kinds.values():
        kind = KINDS[alike[0].kind]
        remarks.append(Remark(kind.severity, kind.headline, kind.means, kind.advice, "; ".join(sentences(alike))))
    return remarks


def remarks(data: ReportData) -> list[Remark]:
    """The verdict, then all remarks, the weightiest first."""
    worst, order = data.estimate.verdict.severity, list(Severity)
    others = [*finding_remarks(data.estimate.all_findings), *_sureness_remarks(data)]
    others.sort(key=lambda remark: order.index(remark.weight), reverse=True)
    return [Remark(worst, f"{VERDICTS[worst]}."), *others]


def _sureness_remarks(data: ReportData) -> list[Remark]:
    """What the uncertainties say, beside the findings."""
    sigma = limb_sigma(data.estimate.wearers)
    if not math.isfinite(sigma):
        return [
            Remark(
                Severity.NOTE,
                "How sure the angles are was not computed",
                "The file holds no uncertainties, so this report cannot say how far the angles may be off.",
                "Reconstruct with “vip-factors smooth --covariance” to know.",
            )
        ]
    meaning = (
        "One standard deviation, by the computation's own reckoning: about two of three values lie within. Differences "
        "smaller than twice that are within its uncertainty."
    )
    if mountings_are_held(data.estimate.wearers):
        meaning += (
            " How the sensors sit on the body is taken for known in this figure: a constant offset of some degrees, "
            "the same throughout, may come on top. Ranges and changes within the recording suffer little from it."
        )
    joints = [joint for wearer in data.wearers for joint in _least_certain_joint(wearer, len(data.wearers) > 1)]
    return [
        Remark(Severity.NOTE, f"Joint angles are known to about ± {degrees(sigma)}", meaning),
        *([Remark(Severity.NOTE, f"Least certain joint: {', '.join(joints)}")] if joints else []),
    ]


def _least_certain_joint(wearer: ReportWearer, with_name: bool) -> list[str]:
    covariance = wearer.estimate.covariance
    if covariance is None:
        return []
    sigma = np.rad2deg(np.nanmedian(covariance.joint_sigma[:, LIMB_JOINTS], axis=0))
    worst = int(np.nanargmax(sigma))
    joint = f"{joint_words(JOINT_NAMES[LIMB_JOINTS[worst]])} (± {sigma[worst]:.0f}°)"
    return [f"{wearer.name}: {joint}" if with_name else joint] if np.isfinite(sigma[worst]) else []
