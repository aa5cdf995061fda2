"""Sessions in several files: joined files equal the recording that they were cut from, and other files are refused."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.errors import InputError, RecordingError
from vip_factors.sensors.calibration import Placement, preset
from vip_factors.sensors.multi_file import join_recordings, join_scenes, join_sources
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import RecordingInMemory
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording

BEGAN = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def recording() -> Recording:
    motion = gestures(3.0)
    made = simulate_recording(motion, preset("sip6", motion.skeleton))
    return replace(made, truth=None, placement=Placement(made.placement.sites[1:]))  # one sensor has no place


def part(recording: Recording, start: float, end: float, anew: bool = False) -> Recording:
    """Samples between two instants, on the recording's clock, or on one that began at the first of them."""
    imus = {name: one.cut(start, end) for name, one in recording.imus.items()}
    if not anew:
        return replace(recording, imus=imus)
    imus = {name: replace(one, time=one.time - start) for name, one in imus.items()}
    return replace(recording, imus=imus, start_ns=BEGAN + round(1e9 * start))


@pytest.mark.parametrize("anew", [False, True])
def test_parts_become_the_whole(recording: Recording, anew: bool) -> None:
    """Whether clocks go on or begin anew, in any order, with a sample in two of them, and with a pause."""
    cuts = [(0.0, 1.0), (0.99, 1.5), (2.0, 9.0)]
    parts = [part(recording, *cut, anew) for cut in cuts]
    parts = [parts[1], parts[0], parts[2]]
    whole = join_recordings(parts, ["b", "a", "c"])
    assert whole.imus.keys() == recording.imus.keys()
    for name, stream in recording.imus.items():
        kept = (stream.time <= 1.5) | (stream.time >= 2.0)
        np.testing.assert_allclose(whole.imus[name].time, stream.time[kept], atol=1e-6)
        np.testing.assert_array_equal(whole.imus[name].specific_force, stream.specific_force[kept])
    sampled, memory = join_sources([RecordingInMemory(one) for one in parts], "bac"), RecordingInMemory(whole)
    assert sampled.sensors == memory.sensors != tuple(whole.imus)
    assert sampled.interval == pytest.approx(memory.interval, abs=1e-6)
    assert sampled.head.start_ns == (BEGAN if anew else recording.start_ns)
    for start, end in ((0.5, 1.2), (1.6, 1.9), (-3.0, 2.5)):
        found, expected = sampled.between(start, end), memory.between(start, end)
        assert found.keys() == expected.keys()
        for name, stream in found.items():
            np.testing.assert_allclose(stream.time, expected[name].time, atol=1e-6)
            np.testing.assert_array_equal(stream.R_inertial_sensor, expected[name].R_inertial_sensor)


def test_what_is_no_part_is_refused(recording: Recording) -> None:
    first, second = part(recording, 0.0, 1.0, anew=True), part(recording, 1.0, 2.0, anew=True)
    without = {name: one for name, one in second.imus.items() if name != "head"}
    slow = {
        name: replace(one, time=one.time[::2], specific_force=one.specific_force[::2],
                      R_inertial_sensor=one.R_inertial_sensor[::2], angular_rate=None)
        for name, one in second.imus.items()
    }  # fmt: skip
    site = second.placement.sites[0]
    elsewhere = Placement((replace(site, bone="neck"), *second.placement.sites[1:]))
    refused = {
        r"c begins at 0\.10 s, before a ends at 1\.00": part(recording, 0.1, 2.0, anew=True),
        "c begins 2.0 h after a ended": replace(second, start_ns=second.start_ns + 7200 * 10**9),
        "a has an absolute start time and c has none": replace(second, start_ns=0),
        "without head, unlike a": replace(second, imus=without),
        f"'{site.sensor}' is on neck": replace(second, placement=elsewhere),
        "c is of 'Bea'": replace(second, subject=replace(second.subject, name="Bea")),
        r"times a second, in a .* same rate": replace(second, imus=slow),
    }
    for message, other in refused.items():
        with pytest.raises(InputError, match=message):
            join_recordings([first, other], ["a", "c"])
    unstamped = [replace(one, start_ns=0) for one in (first, second)]
    with pytest.raises(InputError, match="clock restarted, the time between the files is unknown"):
        join_recordings(unstamped, ["a", "c"])
    bea = replace(second, subject=replace(second.subject, name="Bea"))
    with pytest.raises(InputError, match="c has 2 wearers, a 1"):
        join_scenes([Scene("s", (first,)), Scene("s", (second, bea))], ["a", "c"])


def test_a_part_without_samples_is_refused_by_name(recording: Recording) -> None:
    empty = replace(recording, imus={})
    for join in (
        lambda: join_sources([RecordingInMemory(recording), RecordingInMemory(empty)], ["a.mcap", "b.mcap"]),
        lambda: join_recordings([empty, recording], ["b.mcap", "a.mcap"]),
    ):
        with pytest.raises(InputError, match=r"b\.mcap holds no samples of any sensor: leave it out"):
            join()
    with pytest.raises(RecordingError, match="holds no samples of any sensor"):
        _ = RecordingInMemory(empty).interval
