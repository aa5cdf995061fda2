"""A small scene for the tests of live sources, and what arrives of it."""

from collections.abc import Iterable
from dataclasses import replace
from threading import Thread
from typing import Any

from live_sender import live_messages
from mcap_samples import assert_same
from scene_samples import filmed_walk
from websockets.sync.client import connect

from vip_factors.io.live_network import WebSocketSource
from vip_factors.io.live_open import open_source
from vip_factors.io.live_source import LiveSource
from vip_factors.io.settings import LiveSourceSettings
from vip_factors.sensors.live import LiveFinding, LiveItem, LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene

# Short waits, and nobody is waited for after the first good client.
QUICK = LiveSourceSettings(growth_wait=0.3, next_client_wait=0.0, queue_limit=100_000)
PATIENT = replace(QUICK, next_client_wait=20.0)


def short_walk() -> Scene:
    """One wearer of six sensors for 1.2 s, and a camera; as a plain sender has no truth to send."""
    scene = filmed_walk(5)
    wearer = replace(scene.wearers[0], truth=None)
    return replace(
        scene,
        wearers=(replace(wearer, imus={name: stream.cut(0.0, 1.2) for name, stream in wearer.imus.items()}),),
        cameras=tuple(replace(camera, truth=None) for camera in scene.cameras),
    )


def sorted_out(items: Iterable[LiveItem]) -> tuple[list[LiveSample], list[str]]:
    """Samples and sentences, each in order."""
    samples: list[LiveSample] = []
    sentences: list[str] = []
    for item in items:
        if isinstance(item, LiveFinding):
            sentences.append(item.sentence)
        else:
            samples.append(item)
    return samples, sentences


def received(source: LiveSource) -> tuple[Scene, list[LiveSample], list[str]]:
    """Set-up, samples and sentences of an entered source."""
    setup = source.setup
    return (setup, *sorted_out(source))


def assert_arrived(scene: Scene, setup: Scene, samples: list[LiveSample]) -> None:
    assert_same(stream_head(scene), setup)
    assert_same(tuple(live_samples(scene)), tuple(samples))


def listening(text: str = "ws://127.0.0.1:0", settings: LiveSourceSettings = QUICK, **options: Any) -> WebSocketSource:
    source = open_source(text, settings=settings, **options)
    assert isinstance(source, WebSocketSource)
    return source


def send_scene(url: str, scene: Scene) -> None:
    with connect(url) as client:
        for message in live_messages(scene):
            client.send(message)


class Background:
    """Runs a sender beside the test; leaving the context waits for it and raises what it raised."""

    def __init__(self, target, *arguments) -> None:  # type: ignore[no-untyped-def]
        self._error: BaseException | None = None

        def run() -> None:
            try:
                target(*arguments)
            except BaseException as error:
                self._error = error

        self._thread = Thread(target=run, daemon=True)

    def __enter__(self) -> "Background":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(20)
        if self._error is not None:
            raise self._error
