"""Shapes and text written as SVG: a handful of elements, in the order in which they are painted."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

Point = tuple[float, float]

FONT = "'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"
INK, MUTED, FAINT, RULE = "#1f2933", "#66717f", "#98a2ae", "#d9dee5"
LETTER = 0.57  # generous width of a letter, in sizes of the text: fonts differ


def text_width(text: str, size: float) -> float:
    """Width in pixels that a text takes at most, about."""
    return LETTER * size * len(text)


def tinted(colour: str, share: float) -> str:
    """A colour ``#rrggbb`` with ``share`` of white in it."""
    channels = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round((1 - share) * one + share * 255):02x}" for one in channels)


@dataclass
class Svg:
    """A white picture of a size in pixels; x goes right, y down."""

    width: float
    height: float
    elements: list[str] = field(default_factory=list)

    def line(self, start: Point, end: Point, colour: str, width: float = 1.1, opacity: float = 1.0) -> None:
        """A straight line."""
        self._path(f"M {_at(start)} L {_at(end)}", colour, width, opacity)

    def curve(self, points: Sequence[Point], colour: str, width: float = 1.1, opacity: float = 1.0) -> None:
        """A cubic Bézier curve: start, two points that pull, end."""
        start, *rest = (_at(one) for one in points)
        self._path(f"M {start} C {' '.join(rest)}", colour, width, opacity)

    def _path(self, d: str, colour: str, width: float, opacity: float) -> None:
        self.elements.append(
            f'<path d="{d}" fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-opacity="{opacity:g}" '
            'stroke-linecap="round"/>'
        )

    def circle(self, centre: Point, radius: float, fill: str, stroke: str, width: float = 1.6) -> None:
        """A circle; a ring if ``fill`` is ``none``."""
        self.elements.append(
            f'<circle cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" r="{radius:g}" fill="{fill}" stroke="{stroke}" '
            f'stroke-width="{width:g}"/>'
        )

    def polygon(self, points: Sequence[Point], fill: str, stroke: str = "none", width: float = 1.0) -> None:
        """A closed shape."""
        self.elements.append(
            f'<polygon points="{" ".join(_at(one) for one in points)}" fill="{fill}" stroke="{stroke}" '
            f'stroke-width="{width:g}" stroke-linejoin="round"/>'
        )

    def box(
        self, corner: Point, size: tuple[float, float], fill: str, stroke: str = "none", radius: float = 10.0
    ) -> None:
        """A rectangle by its upper left corner, with round corners."""
        self.elements.append(
            f'<rect x="{corner[0]:.1f}" y="{corner[1]:.1f}" width="{size[0]:.1f}" height="{size[1]:.1f}" '
            f'rx="{radius:g}" fill="{fill}" stroke="{stroke}"/>'
        )

    def text(
        self, at: Point, text: str, size: float = 12, colour: str = INK, anchor: str = "start", bold: bool = False,
        halo: bool = False,
    ) -> None:  # fmt: skip
        """Write from, around or up to (``anchor``: start, middle, end) a point on the baseline.

        With a halo the text is written in white below itself: it stays legible over lines.
        """
        weight = ' font-weight="600"' if bold else ""
        place = f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" font-size="{size:g}" text-anchor="{anchor}"{weight}'
        if halo:
            white = ' fill="#ffffff" stroke="#ffffff" stroke-width="3.5" stroke-linejoin="round"'
            self.elements.append(f"{place}{white}>{escape(text)}</text>")
        self.elements.append(f'{place} fill="{colour}">{escape(text)}</text>')

    def __str__(self) -> str:
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" '
            f'width="{self.width:g}" height="{self.height:g}" font-family="{FONT}">'
        )
        ground = f'<rect x="0" y="0" width="{self.width:g}" height="{self.height:g}" fill="#ffffff"/>'
        return "\n".join([head, ground, *self.elements, "</svg>", ""])


def _at(point: Point) -> str:
    return f"{point[0]:.1f} {point[1]:.1f}"
