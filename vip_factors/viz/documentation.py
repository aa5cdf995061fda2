"""The drawings of the documentation: ``python -m vip_factors.viz.documentation docs``."""

import sys
from pathlib import Path

from vip_factors.viz.checkerboard import checkerboard
from vip_factors.viz.frames_picture import frames_picture
from vip_factors.viz.new_file import new_file
from vip_factors.viz.poses_picture import poses_picture
from vip_factors.viz.sites_picture import sites_picture

DRAWINGS = {
    "checkerboard.svg": checkerboard,
    "frames.svg": frames_picture,
    "poses.svg": poses_picture,
    "sites.svg": sites_picture,
}


def main(folder: Path) -> None:
    """Draw all of them into a folder, over those that are there."""
    for name, draw in DRAWINGS.items():
        with new_file(folder / name, overwrite=True) as partial:
            partial.write_text(draw(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
