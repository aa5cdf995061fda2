"""A checkerboard to print, for calibrating cameras (SVG, A4)."""

from vip_factors.viz.svg import MUTED, Svg

PAGE_MM = (297.0, 210.0)
SQUARES, SQUARE_MM = (10, 7), 25.0  # 9 by 6 inner corners: odd and even, so that the board has one way up


def checkerboard() -> str:
    """The page as SVG text; a unit of it is a millimetre."""
    svg = Svg(*PAGE_MM)
    left, top = ((page - count * SQUARE_MM) / 2 for page, count in zip(PAGE_MM, SQUARES, strict=True))
    for column in range(SQUARES[0]):
        for row in range(SQUARES[1]):
            if (column + row) % 2 == 0:
                svg.box((left + column * SQUARE_MM, top + row * SQUARE_MM), (SQUARE_MM, SQUARE_MM), "#000000", radius=0)
    corners = "x".join(str(count - 1) for count in SQUARES)
    told = f"--checkerboard {corners} --square-m {SQUARE_MM / 1000:g} · print at 100 %, measure: ten squares are 250 mm"
    svg.text((left, PAGE_MM[1] - 8), told, 4, MUTED)
    width, height = PAGE_MM
    return str(svg).replace(
        f'width="{width:g}" height="{height:g}" font', f'width="{width:g}mm" height="{height:g}mm" font'
    )
