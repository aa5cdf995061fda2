"""The first section: who, how long, the few figures that a person wants, and whether to trust them."""

from collections.abc import Sequence

import numpy as np

from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.findings import KINDS, TEXT, VERDICTS, Finding, Severity, sentences
from vip_factors.report.blocks import (
    Block,
    Paragraph,
    Remark,
    Remarks,
    Section,
    Tile,
    Tiles,
    capital,
    count,
    joint_words,
    listed,
    seconds_words,
    with_unit,
)
from vip_factors.report.material import Material, Wearer

# The joints that carry limbs: those of the spine share one bend among them, which is known better than its parts.
LIMB_JOINTS = tuple(
    index for index, name in enumerate(JOINT_NAMES) if name.endswith(("hip", "knee", "ankle", "shoulder", "elbow"))
)
HELD_WORDS = (
    " How the sensors sit on the body is taken for known in this figure: a constant offset of some degrees, the same "
    "throughout, may come on top. Ranges and changes within the recording suffer little from it."
)


def remarks_of(findings: Sequence[Finding]) -> list[Remark]:
    """A remark for every kind of finding there is, with the findings themselves as its detail."""
    together: dict[str, list[Finding]] = {}  # bare sentences each by itself
    for one in findings:
        together.setdefault(one.text if one.kind == TEXT else one.kind, []).append(one)
    kinds = [(KINDS[those[0].kind], "; ".join(sentences(those))) for those in together.values()]
    return [Remark(kind.severity, kind.headline, kind.means, kind.advice, told) for kind, told in kinds]


def summary_section(material: Material) -> Section:
    """Figures, verdict, and what it rests on."""
    remarks = [*remarks_of(material.estimate.all_findings), *_sureness(material)]
    remarks.sort(key=lambda one: list(Severity).index(one.weight), reverse=True)
    worst = material.estimate.verdict.severity
    blocks: list[Block] = [
        Paragraph(_sentence(material)),
        Tiles(_tiles(material)),
        Remarks((Remark(worst, f"{capital(VERDICTS[worst])}."), *remarks)),
    ]
    blocks.append(
        Paragraph(
            "These are measurements of movement, made by a computation from sensors (and video, where there is one). "
            "They are not a diagnosis.",
            small=True,
        )
    )
    return Section("summary", "Summary", tuple(blocks))


def _sentence(material: Material) -> str:
    estimate, wearers = material.estimate, material.wearers
    seconds = max(len(one.estimate.motion) / one.estimate.motion.rate for one in wearers)
    each = sorted({len(one.estimate.sensors) for one in wearers})
    sensors = count(each[0], "sensor") if len(each) == 1 else f"{each[0]} to {each[-1]} sensors"
    filmed = "and a camera" if estimate.camera is not None else "without a camera"
    some = " each" if len(wearers) > 1 else ""
    return (
        f"{listed([one.name for one in wearers])}: {seconds_words(seconds)} of movement, reconstructed from {sensors}"
        f"{some} {filmed} (method {estimate.method})."
    )


def _tiles(material: Material) -> tuple[Tile, ...]:
    wearers, camera = material.wearers, material.estimate.camera
    motion = wearers[0].estimate.motion
    tiles = [
        Tile("Duration", f"{len(motion) / motion.rate:.1f} s", f"{len(motion)} frames at {motion.rate:g} Hz"),
        Tile("People", str(len(wearers)), f"{sum(len(one.estimate.sensors) for one in wearers)} sensors in all"),
    ]
    sigma = limb_sigma_deg(wearers)
    tiles.append(
        Tile(
            "Joint angles",
            f"± {sigma:.1f}°",
            "typical of the limbs; how sensors sit not included"
            if mountings_held(wearers)
            else "typical of the limbs, one standard deviation",
        )
        if sigma is not None
        else Tile("Joint angles", "± unknown", "smooth with --covariance to know")
    )
    off = [one.estimate.residuals.get("orientation_deg") for one in wearers]
    values = np.concatenate([one[np.isfinite(one)] for one in off if one is not None] or [np.zeros(0)])
    if len(values):
        tiles.append(Tile("Fit to the sensors", f"{np.median(values):.1f}°", "median difference of orientation"))
    if camera is not None and camera.residual_px is not None and np.isfinite(camera.residual_px).any():
        middle = float(np.nanmedian(camera.residual_px))
        share = 100 * middle / camera.model.height
        tiles.append(Tile("Fit to the video", f"{middle:.0f} px", f"{share:.1f} % of the image's height"))
    if len(wearers) == 1:
        tiles.append(_length_tile(wearers[0]))
    return tuple(tiles)


def _length_tile(wearer: Wearer) -> Tile:
    body = wearer.estimate.body
    found = body is not None and len(body.names) > 0
    return Tile(
        "Stature of the body", with_unit(stature_of(wearer.estimate.motion.skeleton), "m", 2),
        "lengths fitted to the video" if found else "lengths as given, not measured here",
    )  # fmt: skip


def limb_sigma_deg(wearers: tuple[Wearer, ...]) -> float | None:
    """The median standard deviation of the limbs' joint rotations in degrees; None where it was not asked for."""
    known = [one.estimate.covariance.joint_sigma[:, LIMB_JOINTS] for one in wearers if one.estimate.covariance]
    if not known:
        return None
    values = np.concatenate([one.ravel() for one in known])
    values = values[np.isfinite(values)]
    return float(np.rad2deg(np.median(values))) if len(values) else None


def mountings_held(wearers: tuple[Wearer, ...]) -> bool:
    """Whether how the sensors sit counts as known in the uncertainties of the poses."""
    known = [np.isfinite(one.heading_sigma) for wearer in wearers for one in wearer.estimate.calibration.values()]
    return bool(known) and not any(known)


def _sureness(material: Material) -> list[Remark]:
    """What the uncertainties say, beside the findings."""
    sigma = limb_sigma_deg(material.wearers)
    if sigma is None:
        return [
            Remark(
                Severity.NOTE,
                "How sure the angles are was not computed",
                "The file holds no uncertainties, so this report cannot say how far the angles may be off.",
                "Reconstruct with “vip-factors smooth --covariance” to know.",
            )
        ]
    named, held = len(material.wearers) > 1, mountings_held(material.wearers)
    remarks = [
        Remark(
            Severity.NOTE,
            f"Joint angles are known to about ± {sigma:.1f}°",
            "One standard deviation, by the computation's own reckoning: about two of three values lie within. "
            "Differences smaller than twice that are within its uncertainty." + (HELD_WORDS if held else ""),
        )
    ]
    doubtful = [
        f"{one.name + ': ' if named else ''}{joint_words(name)}"
        for one in material.wearers
        for name in _worst_joint(one)
    ]
    if doubtful:
        remarks.append(Remark(Severity.NOTE, f"Least certain joint: {', '.join(doubtful)}"))
    return remarks


def _worst_joint(wearer: Wearer) -> list[str]:
    covariance = wearer.estimate.covariance
    if covariance is None:
        return []
    sigma = np.rad2deg(np.nanmedian(covariance.joint_sigma[:, LIMB_JOINTS], axis=0))
    worst = int(np.nanargmax(sigma))
    return [f"{JOINT_NAMES[LIMB_JOINTS[worst]]} (± {sigma[worst]:.0f}°)"] if np.isfinite(sigma[worst]) else []
