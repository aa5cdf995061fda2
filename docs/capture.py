"""Pictures of the documentation that a browser draws: ``python docs/capture.py``, from a clone; it takes some minutes.

Needs Chromium and ``pip install '.[dev]'``. The viewer of the report's page draws the bodies. It also draws the video
that a simulated scene does not have: the people as they really moved, through the true camera.
"""

import base64
import shutil
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from time import sleep

import numpy as np
from matplotlib.ticker import MaxNLocator
from PIL import Image
from playwright.sync_api import Browser, Error, Page, sync_playwright
from scipy.spatial.transform import Rotation

import vip_factors as vip
from vip_factors.cli.main import main
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.scene import Video
from vip_factors.viz.charts import GRID, SOFT_INK, page, panel, pixels, seconds_axis, write
from vip_factors.viz.colours import hexadecimal, mixed, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, drawn_scene
from vip_factors.viz.film import overlaid_frames, png_bytes

DOCS = Path(__file__).parent
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SCENE = ["--also", "gestures", "--camera", "hand-held", "--seconds", "6", "--heading-offset-deg", "45", "--seed", "1"]
LIVE = ["--camera", "fixed", "--bystanders", "1", "--seconds", "20", "--heading-offset-deg", "45"]
FLOOR = """() => {  // a floor with a tone of its own, which fades into the wall
    const { world } = canvas, [shadows] = world.ground.children.filter((part) => part.isMesh);
    const material = world.bodies[0].root.children.find((part) => part.isMesh).material.clone();
    Object.assign(material, { vertexColors: false, transparent: false, opacity: 1 });
    material.color.set("#cdced0");
    const floor = new shadows.constructor(shadows.geometry, material);
    floor.position.setZ(-0.01);
    world.ground.add(floor);
    Object.assign(world.scene.fog, { near: 7, far: 17 });
}"""
PORT, SHOWN_S = 8097, 16.0  # of the live page
FINER = 2  # pixels drawn for one that is kept, along each side

HERO_RATE = 15.0  # pictures per second
ROOM, FILM, CHART = (0, 0, 504, 480), (510, 0, 408, 230), (510, 236, 408, 244)  # left, top, width, height
EYE = """world.eye.fov = 30;
world.eye.position.copy(world.middle()).add({ x: 4.0, y: -3.7, z: 1.3 });
world.eye.lookAt(world.middle());"""
HIGHEST_DEG = 45.0


class Viewer:
    """The 3D view of a report's page, at any time and size, from anywhere."""

    def __init__(self, tab: Page) -> None:
        self.tab = tab
        tab.evaluate(FLOOR)
        tab.evaluate("canvas.world.paint({ground: '#f3f5f7', major: '#9da1a6', minor: '#b4b7bb', wire: '#8a94a0'})")
        tab.evaluate(
            "canvas.world.scene.children.filter((part) => part.isLine).forEach((part) => part.visible = false)"
        )

    def people(self, truth: bool) -> None:
        """Show the estimated bodies, or those of the truth as solid ones."""
        self.tab.evaluate(
            """(truth) => canvas.world.bodies.forEach((body, index) => {
                const { ghost } = canvas.world.data.bodies[index];
                body.root.visible = ghost === truth;
                if (ghost) body.root.traverse((part) => part.isMesh && Object.assign(part, { castShadow: true })
                    && Object.assign(part.material, { opacity: 1, transparent: false, needsUpdate: true }));
            })""",
            truth,
        )
        self.tab.evaluate("(truth) => canvas.world.cameras.forEach(({ frustum }) => (frustum.visible = !truth))", truth)

    def picture(self, time: float, size: tuple[int, int], eye: str) -> np.ndarray:
        """``(height, width, 3)`` uint8, red green blue; ``eye`` is JavaScript that sets ``world.eye``."""
        url = self.tab.evaluate(
            f"""([time, width, height]) => {{
                const world = canvas.world, {{ start, rate, frames }} = world.data;
                world.show(Math.min(Math.max((time - start) * rate, 0), frames - 1));
                world.eye.aspect = width / height;
                {eye}
                world.eye.updateProjectionMatrix();
                world.renderer.setPixelRatio(1);
                world.renderer.setSize(width, height, false);
                world.renderer.render(world.scene, world.eye);
                return canvas.toDataURL("image/png");
            }}""",
            [time, FINER * size[0], FINER * size[1]],
        )
        image = Image.open(BytesIO(base64.b64decode(url.partition(",")[2])))
        return smaller(np.asarray(image.convert("RGB")), size)


def smaller(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A picture at another size, with smooth edges."""
    return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BOX))


def through(path: CameraPath, model: vip.CameraModel, time: float) -> str:
    """JavaScript that puts the viewer's eye where a camera is at a time (s)."""
    at = path.at(np.array([time]))
    quaternion = Rotation.from_matrix(at.R_world_camera[0] @ np.diag([1.0, -1.0, -1.0])).as_quat()
    fov = 2 * np.rad2deg(np.arctan(model.height / 2 / model.focal[1]))
    return (
        f"world.eye.fov = {fov}; world.eye.position.fromArray({at.p_world_camera[0].tolist()});"
        f"world.eye.quaternion.fromArray({quaternion.tolist()});"
    )


def footage(viewer: Viewer, drawn: DrawnScene) -> Video:
    """A video of the people as they really moved, through the true camera."""
    viewer.people(truth=True)
    camera, detections, _ = drawn.films()[0]
    size, images = (camera.model.width // 2, camera.model.height // 2), {}
    for frame, time in enumerate(detections.time.tolist()):
        picture = viewer.picture(time, size, through(camera.true_path, camera.model, time))
        images[frame] = png_bytes(picture[..., ::-1])
    return Video(None, images)


def heading_errors(scene: vip.Scene) -> list[tuple[Array, Array]]:
    """Times ``(n,)`` in seconds and errors ``(n, S)`` in degrees of each wearer's headings, as a stream finds them.

    What all sensors of a wearer share in an instant is taken off: the whole scene may be turned. The first instant is
    0 s, with the headings as they came.
    """
    answers = list(vip.Stream(scene, real_time=False).estimates(vip.live_samples(scene)))
    errors = []
    for number, wearer in enumerate(scene.wearers):
        truth = {name: calibration.heading for name, calibration in wearer.truth.calibration.items()}
        found = [[answer.wearers[number].calibration[name].heading for name in truth] for answer in answers]
        off = np.array([[0.0] * len(truth), *found]) - list(truth.values())
        shared = np.angle(np.exp(1j * off).mean(axis=1, keepdims=True))
        errors.append((np.array([0.0, *(answer.time for answer in answers)]), np.rad2deg(wrap_angle(off - shared))))
    return errors


def heading_chart(errors: list[tuple[Array, Array]], time: float, last: float, size: tuple[int, int]) -> np.ndarray:
    """A line for each sensor in its wearer's colour, strong up to a time (s), pale after it."""
    figure, text = page(*size), 15.0
    axes = panel(figure, (2.9 * text, 2.9 * text, size[0] - 0.8 * text, size[1] - 1.9 * text))
    axes.tick_params(labelsize=0.8 * text, pad=4)
    axes.set_ylim(-HIGHEST_DEG, HIGHEST_DEG)
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 3, 5, 10]))
    axes.yaxis.set_major_formatter("{x:.0f}°")
    axes.grid(axis="y", color=GRID, linewidth=1)
    seconds_axis(axes, 0.0, last, 6)
    axes.axvline(time, color="#969ca6", linewidth=1)
    now = []
    for number, (times, values) in enumerate(errors):
        colour = wearer_colour(number)
        for curve in values.T:
            here = float(np.interp(time, times, curve))
            past, future = times <= time, times >= time
            axes.plot(times[future], curve[future], color=hexadecimal(mixed(colour, (255, 255, 255), 0.82)), lw=1.4)
            axes.plot(
                [*times[past], time],
                [*curve[past], here],
                color=hexadecimal(mixed(colour, (255, 255, 255), 0.25)),
                lw=1.4,
            )
            axes.plot(time, here, "o", color=hexadecimal(colour), markersize=6, zorder=5, clip_on=False)
            now.append(here)
    write(figure, (0.6 * text, 1.5 * text), "Heading errors", text, weight="bold")
    write(figure, (9.8 * text, 1.5 * text), f"of {len(now)} sensors", text, SOFT_INK)
    median = f"median {np.median(np.abs(now)):.0f}°"
    write(figure, (size[0] - 0.8 * text, 1.5 * text), median, text, weight="bold", ha="right")
    return pixels(figure)


def hero(viewer: Viewer, scene: vip.Scene, drawn: DrawnScene) -> list[Image.Image]:
    """Pictures of the film: bodies in a room, skeletons over what the camera saw, and headings as they settle."""
    video = drawn.films()[0][1].time
    frames = np.arange(0, len(video), round(1 / HERO_RATE / float(np.median(np.diff(video)))))
    errors = heading_errors(scene)
    seen = overlaid_frames(drawn, frames, (FINER * FILM[2], FINER * FILM[3]), names=False)
    viewer.people(truth=False)
    pictures = []
    for time, film in zip(video[frames].tolist(), seen, strict=True):
        picture = np.full((ROOM[3], FILM[0] + FILM[2], 3), 255, np.uint8)
        room, film = viewer.picture(time, ROOM[2:], EYE), smaller(film, FILM[2:])
        chart = heading_chart(errors, time, float(video[-1]), CHART[2:])
        for (left, top, width, height), part in zip((ROOM, FILM, CHART), (room, film, chart), strict=True):
            picture[top : top + height, left : left + width] = part
        pictures.append(Image.fromarray(picture))
    return pictures


def capture_scene(browser: Browser, folder: Path) -> None:
    """The README's scene: its report, its picture, and its film."""
    path, estimate_path, report = folder / "scene.mcap", folder / "scene.estimate.mcap", folder / "scene.html"
    command("simulate", "gestures", path, *SCENE)
    command("smooth", path)
    command("report", estimate_path, "--recording", path, "--out", report)
    tab = browser.new_page(viewport={"width": 1280, "height": 1380})
    tab.goto(report.as_uri())
    tab.wait_for_selector("body[data-viewer=ready]", timeout=60_000)
    tab.screenshot(path=DOCS / "report.png")
    scene, estimate = vip.read(path), vip.read_estimate(estimate_path)
    drawn, viewer = drawn_scene(scene, estimate), Viewer(tab)
    video = footage(viewer, drawn)
    drawn = replace(drawn, cameras=(replace(drawn.cameras[0], video=video),))
    shown = replace(scene, cameras=(replace(scene.camera, video=video),))
    vip.picture(estimate, DOCS / "scene.png", shown, title="Two wearers before a hand-held camera", overwrite=True)
    first, *others = hero(viewer, scene, drawn)
    first.save(
        DOCS / "hero.webp", save_all=True, append_images=others, duration=round(1000 / HERO_RATE), loop=0, quality=80,
        method=4,
    )  # fmt: skip


def capture_live_page(browser: Browser, folder: Path) -> None:
    """The page of a stream while it goes on."""
    path = folder / "live.mcap"
    command("simulate", "gestures", path, *LIVE)
    words = [sys.executable, "-m", "vip_factors", "stream", path, "--web", str(PORT)]
    with Popen(words, stdout=DEVNULL, stderr=DEVNULL) as stream:
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        while True:
            try:
                tab.goto(f"http://127.0.0.1:{PORT}/")
                break
            except Error:  # it does not listen yet
                if stream.poll() is not None:
                    raise
                sleep(0.2)
        while float((tab.locator("#clock").text_content() or "0").strip(" s") or 0) < SHOWN_S:
            tab.wait_for_timeout(100)
        tab.get_by_role("button", name="front").click()
        tab.screenshot(path=DOCS / "live-page.png")
        stream.terminate()


def command(*words: object) -> None:
    """Run a command of ``vip-factors``."""
    assert main(list(map(str, words))) == 0


def capture() -> None:
    """Make all pictures."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))))
    with (
        TemporaryDirectory() as folder,
        sync_playwright() as tool,
        tool.chromium.launch(executable_path=program, args=FLAGS) as browser,
    ):
        capture_scene(browser, Path(folder))
        capture_live_page(browser, Path(folder))


if __name__ == "__main__":
    capture()
