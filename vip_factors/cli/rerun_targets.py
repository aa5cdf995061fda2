"""What is asked of Rerun, made sure of before the work: the file's suffix, and a display for a window."""

from pathlib import Path

from vip_factors.errors import InputError
from vip_factors.viz.viewer import check_display

__all__ = ["STREAM_INSTEAD", "VIEW_INSTEAD", "check_display", "check_rerun_file"]

RERUN_SUFFIX = ".rrd"
VIEW_INSTEAD = "--serve, --save FILE.rrd, --picture or --video"
STREAM_INSTEAD = "--rerun-serve PORT, --rerun-save FILE.rrd or --rerun-connect URL instead of --rerun"


def check_rerun_file(option: str, path: Path | None) -> None:
    """Make sure that a Rerun file is named as one.

    Args:
        option: that named it, for the message.
        path: the file, or None.

    Raises:
        InputError: if it ends otherwise: another program would be misled.
    """
    if path is None or path.suffix.lower() == RERUN_SUFFIX:
        return
    from vip_factors.io.export.files import FORMATS

    raise InputError(
        f"{path}: {option} writes Rerun files, expected a name that ends in {RERUN_SUFFIX}; for "
        f"{', '.join(FORMATS)} use vip-factors export"
    )
