"""How the estimate was made: method, solves, settings; for whoever wants to repeat it."""

from vip_factors import __version__
from vip_factors.report.blocks import Block, Heading, Paragraph, Section, Table
from vip_factors.report.material import Material


def made_section(material: Material) -> Section:
    """Folded away, but for the method."""
    estimate = material.estimate
    reports = [*estimate.reports, *(report for one in material.wearers for report in one.estimate.reports)]
    blocks: list[Block] = [
        Paragraph(f"Method {estimate.method}; this page was made by vip_factors {__version__}."),
        Heading("Words"),
        Table(("Word", "Meaning"), GLOSSARY, words=2),
    ]
    if reports:
        rows = [
            (
                one.stage, str(len(one.iterations)), f"{sum(one.initial_cost.values()):.4g}",
                f"{sum(one.final_cost.values()):.4g}", "yes" if one.converged else "no", f"{one.seconds:.1f} s",
            )
            for one in reports
        ]  # fmt: skip
        head = ("Solve", "Steps", "Cost before", "Cost after", "Settled", "Time")
        blocks.append(Table(head, rows, "How the solves went", folded=True))
    settings = estimate.settings or (material.wearers[0].estimate.settings if material.wearers else {})
    if settings:
        blocks.append(Table(("Setting", "Value"), sorted(settings.items()), "Settings", words=2, folded=True))
    return Section("made", "How it was made", tuple(blocks))


GLOSSARY = (
    ("heading", "the direction about the vertical that a sensor takes for zero"),
    ("mounting", "how a sensor is turned on the segment that it is strapped to"),
    ("±", "one standard deviation: about two of three values lie within, nearly all within twice of it"),
    ("difference, residual", "what was measured less what the reconstructed motion would have measured"),
    ("95 % below", "only one value in twenty is larger"),
    ("px", "pixels of the video's image"),
)
