"""Colours of the page: sides and wearers as in every other picture."""

from vip_factors.body.mannequin import ESTIMATE_COLOURS, TRUTH_COLOUR, Colour, Side
from vip_factors.viz.wearer_colours import body_colours, wearer_colour


def hexadecimal(colour: Colour) -> str:
    """``#rrggbb``."""
    return "#" + "".join(f"{channel:02x}" for channel in colour)


SIDE_COLOURS = {side: hexadecimal(colour) for side, colour in ESTIMATE_COLOURS.items()}
TRUTH = hexadecimal(TRUTH_COLOUR)


def wearer_mark(index: int, of: int) -> str:
    """What marks a wearer's curves: of one alone the trunk's grey."""
    return SIDE_COLOURS[Side.MIDDLE] if of == 1 else hexadecimal(wearer_colour(index))


def sides_of(index: int, of: int) -> dict[Side, str]:
    """Of a body in the 3D view: by side of one wearer alone, else all in the wearer's own."""
    return SIDE_COLOURS if of == 1 else {side: hexadecimal(one) for side, one in body_colours(index).items()}
