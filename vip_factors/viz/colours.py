"""Colours: one per wearer, the same in every picture and plot (nobody's is grey), one per sensor, one per side."""

from collections.abc import Sequence
from colorsys import hls_to_rgb

from vip_factors.body.mannequin import ESTIMATE_COLOURS, Colour, Side

# Bright enough on a dark video, dark enough on white paper, and apart for the common kinds of colour blindness
# (after Okabe & Ito's set).
_PALETTE: tuple[Colour, ...] = (
    (240, 138, 36),
    (56, 160, 226),
    (20, 170, 130),
    (214, 110, 178),
    (190, 170, 30),
    (140, 120, 235),
)
_NAMES = ("orange", "blue", "green", "pink", "olive", "violet")
STRANGER_COLOUR: Colour = (150, 154, 162)
GHOST_COLOUR: Colour = (92, 98, 108)  # in the viewer what a body is compared with: dark on its bright background
UNCLAIMED: Colour = (206, 210, 217)  # detections that are nobody's, over a picture: a lighter grey than on paper


def mixed(colour: Colour, target: Colour, share: float) -> Colour:
    """``share`` of another colour in a colour."""
    red, green, blue = (round((1 - share) * a + share * b) for a, b in zip(colour, target, strict=True))
    return red, green, blue


def hexadecimal(colour: Colour) -> str:
    """A colour as ``#rrggbb``."""
    return "#" + "".join(f"{channel:02x}" for channel in colour)


def sensor_colours(sensors: Sequence[str]) -> dict[str, Colour]:
    """A colour per sensor, the same in every plot."""
    colours: dict[str, Colour] = {}
    # Hues in golden steps and three lightnesses: seventeen sensors can be distinguished.
    hue_step, lightness = 0.381966, (0.42, 0.56, 0.68)
    for index, sensor in enumerate(sensors):
        red, green, blue = hls_to_rgb((0.58 + index * hue_step) % 1.0, lightness[index % 3], 0.65)
        colours[sensor] = (round(255 * red), round(255 * green), round(255 * blue))
    return colours


def wearer_colour(index: int) -> Colour:
    """Colour of a wearer; grey for −1, nobody. They repeat after six."""
    return STRANGER_COLOUR if index < 0 else _PALETTE[index % len(_PALETTE)]


def colour_name(index: int) -> str:
    """Name of a wearer's colour."""
    return _NAMES[index % len(_NAMES)]


def body_colours(index: int) -> dict[Side, Colour]:
    """A wearer's body: the left limbs lighter, the right ones darker than the trunk."""
    colour = wearer_colour(index)
    return {
        Side.MIDDLE: mixed(colour, (90, 96, 108), 0.25),
        Side.LEFT: mixed(colour, (255, 255, 255), 0.35),
        Side.RIGHT: mixed(colour, (0, 0, 0), 0.30),
    }


SIDE_COLOURS = {side: hexadecimal(colour) for side, colour in ESTIMATE_COLOURS.items()}


def wearer_mark(index: int, wearers: int) -> str:
    """Colour of a wearer's curves: the trunk's grey where there is one wearer alone."""
    return SIDE_COLOURS[Side.MIDDLE] if wearers == 1 else hexadecimal(wearer_colour(index))


def side_colours(index: int, wearers: int) -> dict[Side, str]:
    """Colours of a body in the 3D view: by side where there is one wearer alone, else shades of the wearer's own."""
    if wearers == 1:
        return SIDE_COLOURS
    return {side: hexadecimal(colour) for side, colour in body_colours(index).items()}
