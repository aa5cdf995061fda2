"""One colour per wearer, the same in the image, in the world and in every plot; nobody's is grey."""

from vip_factors.body.mannequin import Colour, Side
from vip_factors.viz.canvas import mixed

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
UNCLAIMED: Colour = (206, 210, 217)  # detections that are nobody's, over a picture: a lighter grey than on paper


def wearer_colour(index: int) -> Colour:
    """Colour of a wearer; grey for −1, nobody. They repeat after six."""
    return STRANGER_COLOUR if index < 0 else _PALETTE[index % len(_PALETTE)]


def colour_name(index: int) -> str:
    """What a wearer's colour is called."""
    return _NAMES[index % len(_NAMES)]


def body_colours(index: int) -> dict[Side, Colour]:
    """A wearer's body: the left limbs lighter, the right ones darker than the trunk."""
    colour = wearer_colour(index)
    return {
        Side.MIDDLE: mixed(colour, (90, 96, 108), 0.25),
        Side.LEFT: mixed(colour, (255, 255, 255), 0.35),
        Side.RIGHT: mixed(colour, (0, 0, 0), 0.30),
    }


def skin_colours(index: int) -> dict[Side, Colour]:
    """The same in pictures with light and shadow, which darken by themselves."""
    colour = wearer_colour(index)
    return {
        Side.MIDDLE: mixed(colour, (255, 255, 255), 0.10),
        Side.LEFT: mixed(colour, (255, 255, 255), 0.42),
        Side.RIGHT: mixed(colour, (0, 0, 0), 0.12),
    }
