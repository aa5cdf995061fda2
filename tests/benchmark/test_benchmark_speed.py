"""The speed benchmark runs, and says what it measured."""

import json

from vip_factors.benchmark.speed import SpeedTrials, run_speed, speed_json, speed_table


def test_quick_run_times_every_part_and_measures_memory() -> None:
    speed = run_speed(SpeedTrials.quick())
    assert [one.placement for one in speed.solves] == ["sip6", "totalcapture13"]
    for one in speed.solves:
        assert one.iterations == 3
        assert all(seconds > 0 for seconds in one.seconds_per_iteration.values())
    (memory,) = speed.memory
    assert memory.sensors == 13
    assert abs(memory.frames - 240) <= 1
    assert memory.peak >= memory.before > 10e6
    table = speed_table(speed)
    assert "450" in table
    assert "floor" in table
    assert json.loads(speed_json(speed))["memory"][0]["frames"] == memory.frames
