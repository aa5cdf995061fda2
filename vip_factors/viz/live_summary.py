"""The text beside a stream: what was found, the latest first, and what is drawn how (Markdown)."""

from collections.abc import Sequence

from vip_factors.sensors.live import LiveSetup
from vip_factors.viz.colours import colour_name
from vip_factors.viz.compare import APART

KEPT = 40  # findings that are shown: an hour's list would be sent again with each


def live_summary(setup: LiveSetup, findings: Sequence[tuple[float, str]], apart: bool) -> str:
    """The text.

    Args:
        setup: of what is streamed.
        findings: times in seconds, and sentences, in their order.
        apart: whether the wearers are set apart.
    """
    lines = [f"# {setup.name}", ""]
    if findings:
        lines += ["## Findings", ""]
        lines += [f"- **{time:.1f} s** {sentence}" for time, sentence in reversed(findings[-KEPT:])]
        lines.append("")
    lines += ["## Colours", ""]
    lines += [
        f"- **{wearer.name}**, newest: {colour_name(index)}, solid; left limbs are lighter, right ones darker."
        for index, wearer in enumerate(setup.wearers)
    ]
    lines.append("- Smoothed, a moment earlier: dark grey, see-through.")
    if setup.camera is not None:
        lines.append("- In the picture: bodies are broad lines, detections dots and fine lines; grey are nobody's.")
    lines.append("- Small boxes are the sensors, each in the colour of its curves: see *Sensors' colours*.")
    if apart:
        lines.append(f"- **{APART}**")
    return "\n".join([*lines, ""])
