"""What may be chosen of an exported file, whatever its format."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExportSettings:
    """How an estimate is written into a format of another program."""

    wearer: str | None = None
    """Export this wearer only, by name; of a format that holds one person, each wearer gets a file of its own."""
    frame_rate: float | None = None
    """Frames a second of the file; those of the estimate if absent, for then no frame is interpolated."""
