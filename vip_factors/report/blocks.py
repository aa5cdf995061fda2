"""What a section of the page is made of; the template says how each looks, and escapes every text."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from markupsafe import Markup

from vip_factors.findings import Severity


@dataclass(frozen=True)
class Paragraph:
    """Running text; ``small`` for a remark."""

    kind: ClassVar[str] = "paragraph"
    text: str
    small: bool = False


@dataclass(frozen=True)
class Heading:
    """Of a part of a section."""

    kind: ClassVar[str] = "heading"
    text: str


@dataclass(frozen=True)
class Tile:
    """One figure: what it is, its value, and a remark."""

    label: str
    value: str
    remark: str = ""


@dataclass(frozen=True)
class Tiles:
    """Figures in a row."""

    kind: ClassVar[str] = "tiles"
    tiles: tuple[Tile, ...]


@dataclass(frozen=True)
class Remark:
    """A remark with its weight: a headline, then what it means and what to do."""

    weight: Severity
    headline: str
    meaning: str = ""
    advice: str = ""
    detail: str = ""


@dataclass(frozen=True)
class Remarks:
    """One below the other, the weightiest first."""

    kind: ClassVar[str] = "remarks"
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class Table:
    """Text in rows; the first ``words`` columns hold words, the others numbers. Folded away if ``folded``."""

    kind: ClassVar[str] = "table"
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: int = 1
    folded: bool = False


@dataclass(frozen=True)
class Chart:
    """A drawing of curves over time, with what the page's script needs to read it.

    Attributes:
        title: above it.
        svg: made by us; no text in it comes from outside.
        legend: names and colours of the curves.
        numbers: the curves and the box they are drawn in, as JSON.
    """

    kind: ClassVar[str] = "chart"
    title: str
    svg: Markup
    legend: tuple[tuple[str, str], ...]
    numbers: str


@dataclass(frozen=True)
class Charts:
    """Several, side by side where there is room."""

    kind: ClassVar[str] = "charts"
    charts: tuple[Chart, ...]


@dataclass(frozen=True)
class Image:
    """What is to be seen, as a ``data:`` address, and in words; ``wide`` of a frame of a video."""

    source: str
    alt: str
    wide: bool = False


@dataclass(frozen=True)
class Picture:
    """Images side by side with a headline, text, and the time that they show; None if they show no single one."""

    images: tuple[Image, ...]
    headline: str
    text: str
    time: float | None


@dataclass(frozen=True)
class Pictures:
    """Several, side by side where there is room."""

    kind: ClassVar[str] = "pictures"
    pictures: tuple[Picture, ...]


Block = Paragraph | Heading | Tiles | Remarks | Table | Charts | Pictures


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        id: that links point to.
        title: above it, and in the page's list of sections.
        blocks: in order.
    """

    id: str
    title: str
    blocks: tuple[Block, ...]
