"""How somebody walked: figures of the strides, left against right, and joint angles over the cycle."""

from vip_factors.gait.analysis import Gait, gait_of
from vip_factors.gait.files import curves_figure
from vip_factors.gait.strides import QUANTITIES, Quantity
from vip_factors.report.blocks import Block, Heading, Image, Paragraph, Picture, Pictures, Section, Table, Tile, Tiles
from vip_factors.report.material import Material
from vip_factors.report.moments import png
from vip_factors.report.words import UNKNOWN, capital, count, number, plus_minus
from vip_factors.viz.charts import pixels

FEWEST = 4  # strides: fewer are no walk
SIDES = ("left", "right", "both")


def gait_section(material: Material) -> Section | None:
    """Of the wearers who walk; None if nobody does."""
    blocks: list[Block] = []
    for wearer in material.wearers:
        gait = gait_of(wearer.estimate, wearer.recording, wearer.name, material.estimate.camera is not None)
        if len(gait.counted) < FEWEST:
            continue
        blocks += [Heading(wearer.name)] if len(material.wearers) > 1 else []
        blocks += _wearer(gait)
    return Section("gait", "Gait", tuple(blocks)) if blocks else None


def _wearer(gait: Gait) -> list[Block]:
    left_out = len(gait.strides) - len(gait.counted)
    tiles = [
        Tile(
            "Strides",
            str(len(gait.counted)),
            "all of them" if not left_out else f"{left_out} more are turns, pauses or no steps",
        )
    ]
    for name in ("speed", "cadence", "length", "time"):
        one = gait.figure(name)
        if one is not None:
            value = plus_minus(one.mean, one.sigma, _unit(one.quantity), 2 * (one.mean < 10), 2 * (one.mean < 10))
            tiles.append(Tile(capital(one.quantity.words), value, f"mean of {count(one.count, 'stride')}"))
    rows = [row for one in QUANTITIES if (row := _row(gait, one)) is not None]
    head = ("Quantity", "Left", "Right", "Left less right", "Both", "From stride to stride")
    caption = (
        "Means with one standard deviation: of the strides, and of what all of them share, such as how exactly strikes "
        "and toe-offs are timed and lengths are told. A difference smaller than twice its ± says nothing."
    )
    blocks: list[Block] = [Tiles(tuple(tiles)), Table(head, rows, caption)]
    figure = curves_figure(gait)
    if figure is not None:
        text = (
            "each side from its own foot strike (0 %) to its next (100 %). Dark bands are the mean's ±, pale ones how "
            "strides differ, grey ones healthy adults at a similar speed, where known."
        )
        picture = Image(png(pixels(figure)[..., ::-1]), "joint angles over the gait cycle", wide=True)
        blocks.append(Pictures((Picture((picture,), "Joint angles over the cycle", text, None),)))
    by = {one.by_sensor for one in gait.feet.values()}
    told = "the feet's own sensors" if by == {True} else "the motion of the legs" if by == {False} else "both"
    blocks += [Paragraph(f"{capital(str(one))}.") for one in gait.findings]
    return [*blocks, Paragraph(f"Foot strikes and toe-offs are told by {told}.", small=True)]


def _unit(quantity: Quantity) -> str:
    return {"deg": "°"}.get(quantity.unit, quantity.unit)


def _row(gait: Gait, quantity: Quantity) -> tuple[str, ...] | None:
    found = {side: gait.figure(quantity.name, side) for side in (*SIDES, "difference")}
    both = found["both"]
    if both is None:
        return None
    decimals = min(quantity.decimals, 2) if quantity.unit in ("s", "m", "m/s") else quantity.decimals
    told = {
        side: UNKNOWN if one is None else plus_minus(one.mean, one.sigma, "", decimals, decimals)
        for side, one in found.items()
    }
    name = f"{capital(quantity.words)}, {_unit(quantity)}"
    return name, told["left"], told["right"], told["difference"], told["both"], number(both.variability, decimals)
