"""Squats, lunges, jumps and curls, a row each."""

from vip_factors.repetitions.files import HEAD, rows, summary
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.repetitions.settings import RepetitionSettings
from vip_factors.report.blocks import Block, Heading, Paragraph, Section, Table
from vip_factors.report.material import Material
from vip_factors.report.words import capital

CAPTION = (
    "Down, hold, up: the ways and the stay within a tenth of the lowest. Depth: how far the pelvis sinks. "
    "Flexed: knees, or elbows, at the turn. Height by flight: that free fall takes the centre of mass beyond take-off; "
    "by rise: above standing, which the heels add to. A left less right smaller than twice its ± says nothing."
)


def repetitions_section(material: Material) -> Section | None:
    """Of the wearers who exercise; None if nobody does."""
    blocks: list[Block] = []
    for wearer in material.wearers:
        found = repetitions_of(wearer.estimate, RepetitionSettings()).repetitions
        if not found:
            continue
        blocks += [Heading(wearer.name)] if len(material.wearers) > 1 else []
        blocks += [Paragraph(f"{capital(summary(found))}."), Table(HEAD, rows(found), CAPTION, words=3)]
    return Section("repetitions", "Repetitions", tuple(blocks)) if blocks else None
