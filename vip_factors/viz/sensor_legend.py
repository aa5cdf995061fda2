"""The legend of the sensors' colours: a picture, for Rerun's own legends do not fit into small plots."""

from collections.abc import Mapping

import cv2
import rerun as rr
import rerun.blueprint as rrb

from vip_factors.body.mannequin import Colour
from vip_factors.viz.canvas import Canvas

LEGEND = "legend/sensors"
COLUMNS, COLUMN_PX, ROW_PX, MARGIN_PX = 5, 236, 40, 10  # twice the points of a panel beside the world
TEXT_PX, SQUARE_PX = 24, 20
PAPER: Colour = (16, 17, 19)  # as the plots that it explains
INK: Colour = (214, 218, 224)


def log_legend(stream: rr.RecordingStream, colours: Mapping[str, Colour]) -> bool:
    """Log the legend for ever; returns whether there is any sensor to tell of."""
    if colours:
        picture = cv2.imencode(".png", legend(colours).pixels())[1].tobytes()
        stream.log(LEGEND, rr.EncodedImage(contents=picture, media_type="image/png"), static=True)
    return bool(colours)


def legend(colours: Mapping[str, Colour]) -> Canvas:
    """A square in its colour beside the name of every sensor, columns filled first."""
    rows = -(-len(colours) // COLUMNS)
    width, height = COLUMNS * COLUMN_PX + 2 * MARGIN_PX, rows * ROW_PX + 2 * MARGIN_PX
    canvas = Canvas(width, height)
    canvas.polygon([(0, 0), (width, 0), (width, height), (0, height)], PAPER)
    for index, (sensor, colour) in enumerate(colours.items()):
        left = MARGIN_PX + COLUMN_PX * (index // rows)
        top = MARGIN_PX + ROW_PX * (index % rows) + (ROW_PX - SQUARE_PX) / 2
        right, bottom = left + SQUARE_PX, top + SQUARE_PX
        canvas.polygon([(left, top), (right, top), (right, bottom), (left, bottom)], colour)
        canvas.text((right + 10, bottom - 2), sensor.replace("_", " "), INK, TEXT_PX)
    return canvas


def legend_view() -> rrb.Spatial2DView:
    """The view that shows it."""
    return rrb.Spatial2DView(origin=f"/{LEGEND}", name="Sensors' colours", background=PAPER)
