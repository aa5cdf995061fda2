"""``vip-factors benchmark`` ``stream-latency``, ``-hour``, ``-slow``, ``-kill``, ``disk-full`` and ``long``."""

from collections.abc import Callable

from tests.studies.command_stream_options import (
    DiskFullOptions,
    LongOptions,
    StreamHourOptions,
    StreamKillOptions,
    StreamLatencyOptions,
    StreamSlowOptions,
)
from vip_factors.cli.terminal import Tell


def stream_latency(options: StreamLatencyOptions, tell: Tell) -> tuple[str, str]:
    """The tables and the JSON."""
    from tests.studies.long_stream import LongStreamTrials
    from tests.studies.stream_latency import latency_json, latency_table, run_stream_latency
    from vip_factors.live.settings import LiveSettings

    trials = LongStreamTrials(60 * options.minutes, options.scene_s, options.camera)
    settings = LiveSettings(lag_s=options.lag)
    result = run_stream_latency(trials, settings, tell, options.real_time_s, options.references)
    return latency_table(result), latency_json(result)


def stream_hour(options: StreamHourOptions, tell: Tell, write: Callable[[str], None]) -> tuple[str, str]:
    """The table and the JSON, which is written after each part."""
    from tests.studies.long_stream import LongStreamTrials
    from tests.studies.stream_hour import hour_json, hour_table, run_stream_hour
    from vip_factors.live.settings import LiveSettings

    trials = LongStreamTrials(60 * options.minutes, options.scene_s, options.camera)
    part_s = 60 * options.part_minutes
    if options.whole:
        from tests.studies.stream_whole import run_stream_whole, whole_json, whole_table

        whole = run_stream_whole(trials, options.frame_rate, part_s, tell, lambda so_far: write(whole_json(so_far)))
        return whole_table(whole), whole_json(whole)
    settings = LiveSettings(frame_rate=options.frame_rate)
    result = run_stream_hour(trials, settings, tell, part_s, lambda so_far: write(hour_json(so_far)))
    return hour_table(result), hour_json(result)


def stream_slow(options: StreamSlowOptions, tell: Tell) -> tuple[str, str]:
    """The table and the JSON."""
    from tests.studies.long_stream import LongStreamTrials
    from tests.studies.stream_slow import SlowTrials, run_stream_slow, slow_json, slow_table

    stream = LongStreamTrials(options.seconds, options.seconds + 1.0, options.camera)  # all of it forwards
    trials = SlowTrials(options.seconds, options.begin_s, options.end_s, options.share, options.frame_rate, stream)
    result = run_stream_slow(trials, tell)
    return slow_table(result), slow_json(result)


def long(options: LongOptions, tell: Tell) -> tuple[str, str]:
    """The table and the JSON."""
    from tests.studies.long import long_json, long_table, run_long
    from tests.studies.long_recording import LongRecordingTrials

    result = run_long(LongRecordingTrials(options.hours, options.sensors, options.clip_s), tell)
    return long_table(result), long_json(result)


def stream_kill(options: StreamKillOptions, tell: Tell) -> tuple[str, str]:
    """The line and the JSON."""
    from tests.studies.stream_ends import EndTrials, ends_json, kill_table, run_stream_kill

    found = run_stream_kill(EndTrials(options.kills, options.seconds, options.seed), tell)
    return kill_table(found), ends_json(found)


def disk_full(options: DiskFullOptions, tell: Tell) -> tuple[str, str]:
    """The lines and the JSON."""
    from tests.studies.stream_ends import EndTrials, disk_full_table, ends_json, run_disk_full

    found = run_disk_full(EndTrials(options.streams, options.seconds, options.seed), tell)
    return disk_full_table(found), ends_json(found)
