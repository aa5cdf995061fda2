"""The live page in a browser, by Playwright: it shows what comes, on wide and narrow screens, and asks nobody else."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from http.server import SimpleHTTPRequestHandler
from itertools import count
from socketserver import TCPServer
from threading import Event, Thread

import pytest
from live_answers import LAG, answer, live_scene

from vip_factors.findings import bare
from vip_factors.io.live_server import LiveServer
from vip_factors.report.page import live_page
from vip_factors.sensors.live import stream_head

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
SOFTWARE_GL = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
SCENE = live_scene(1.0)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the PATH")]


@pytest.fixture
def served() -> Iterator[LiveServer]:
    """A server, and answers sixty times a second."""
    pytest.importorskip("websockets", reason="needs the extra live")
    given = [answer(SCENE, frame) for frame in range(LAG, LAG + 30)]
    stop = Event()

    def write() -> None:
        for number in count():
            if stop.wait(1 / 60):
                return
            findings = (bare(f"<b>found {number}</b>"),) if number % 60 == 0 else ()
            server.write(replace(given[number % len(given)], frame=number, findings=findings))

    with LiveServer(stream_head(SCENE), live_page(stream_head(SCENE)), 0) as server:
        thread = Thread(target=write)
        thread.start()
        yield server
        stop.set()
        thread.join()


@pytest.mark.parametrize(("width", "scheme", "gl"), [(1280, "light", True), (390, "dark", True), (390, "light", False)])
def test_the_body_is_seen_as_it_moves(served: LiveServer, width: int, scheme: str, gl: bool) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs the extra dev")
    flags = SOFTWARE_GL if gl else ("--no-sandbox", "--disable-gpu", "--disable-3d-apis")
    with playwright.sync_playwright() as tool, tool.chromium.launch(executable_path=BROWSER, args=[*flags]) as browser:
        page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda websocket: asked.append(websocket.url))
        problems: list[str] = []  # what the content security policy refuses is told at the console
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.goto(served.address)
        page.wait_for_selector("body[data-frame][data-state=live]", timeout=60_000)
        first = page.locator("body").get_attribute("data-frame")
        page.wait_for_selector(f"body:not([data-frame='{first}'])", timeout=60_000)  # it goes on
        page.locator("[data-wearer='1'][data-angle=left_knee_flexion]", has_text="°").wait_for(timeout=60_000)
        page.locator("#findings", has_text="<b>found").wait_for(timeout=60_000)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("html").get_attribute("data-error") is None
        assert [problem for problem in problems if "Content Security Policy" in problem] == []
        assert page.locator("body").get_attribute("data-webgl") == ("yes" if gl else "no")
        if gl:
            assert len({tuple(page.locator("#canvas").screenshot()) for _ in range(3)}) > 1
        else:
            assert page.locator("#no-3d").is_visible()
        page.locator("#pose").select_option("smoothed")
        served.close()
        page.wait_for_selector("body[data-state=ended]", timeout=60_000)
        assert {url.split("/")[2] for url in asked if not url.startswith("data:")} == {f"127.0.0.1:{served.port}"}


def test_a_page_of_another_site_gets_nothing(served: LiveServer) -> None:
    """A page that the browser shows as well: its tags, its scripts and its frames."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs the extra dev")
    attack = """async (port) => {
        const tried = {};
        const here = `127.0.0.1:${port}`;
        const load = (tag) => new Promise((done) => {
            const element = document.createElement(tag);
            element.onload = () => done("loaded");
            element.onerror = () => done("refused");
            element.src = `http://${here}/`;
            document.body.append(element);
        });
        tried.image = await load("img");
        tried.script = await load("script");
        tried.fetch = await fetch(`http://${here}/`, {mode: "no-cors"}).then((answer) => answer.type, () => "refused");
        tried.read = await fetch(`http://${here}/`).then(() => "read", () => "refused");
        tried.socket = await new Promise((done) => {
            const socket = new WebSocket(`ws://${here}/stream`);
            socket.onopen = () => done("opened");
            socket.onerror = () => done("refused");
        });
        await load("iframe");
        return tried;
    }"""
    with (
        TCPServer(("127.0.0.1", 0), SimpleHTTPRequestHandler) as other,
        playwright.sync_playwright() as tool,
        tool.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"]) as browser,
    ):
        Thread(target=other.serve_forever, daemon=True).start()
        page = browser.new_page()
        statuses: list[int] = []
        page.on("response", lambda answer: statuses.append(answer.status) if str(served.port) in answer.url else None)
        page.goto(f"http://localhost:{other.server_address[1]}/")
        tried = page.evaluate(attack, served.port)
        assert tried["image"] == tried["script"] == tried["read"] == tried["socket"] == "refused"
        assert set(statuses) == {403}
        assert page.frames[-1].locator("#canvas").count() == 0
        other.shutdown()
