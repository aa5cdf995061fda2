"""Films for ``vip-factors view``: read what they show beside the files given, and draw with a progress bar."""

from pathlib import Path

from vip_factors.cli.files import Opened
from vip_factors.cli.terminal import progress_bar
from vip_factors.viz.film_settings import FilmSettings


def write_film(opened: Opened, path: Path, settings: FilmSettings, overwrite: bool) -> None:
    """Draw the film of what was opened.

    Raises:
        InputError, FileFormatError: if there is nothing to draw, or a file cannot be read or written.
    """
    from vip_factors.io.calibration_history import read_calibration_history
    from vip_factors.viz.film import film
    from vip_factors.viz.scene_world import DrawnScene, DrawnWearer, drawn_scene

    histories = read_calibration_history(settings.headings) if settings.headings is not None else ()
    scene, estimate = opened.as_scene()
    if scene is None and estimate is None and opened.motion is not None:
        drawn = DrawnScene(opened.motion.name, (DrawnWearer(opened.motion.name, 0, None, opened.motion, None, None),))
    else:
        drawn = drawn_scene(scene, estimate)
    with progress_bar() as tell:
        film(drawn, path, settings, histories, overwrite=overwrite, tell=tell)
