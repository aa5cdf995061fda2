"""``vip-factors benchmark stream-accuracy`` and ``kaichi``: each estimate is told on stderr, and written."""

from collections.abc import Callable

from tests.studies.command_live_options import KaichiOptions, StreamAccuracyOptions
from vip_factors.cli.terminal import Tell, note


def stream_accuracy(options: StreamAccuracyOptions, tell: Tell, write: Callable[[str], None]) -> tuple[str, str]:
    """The table and the JSON."""
    from tests.studies.stream_accuracy import StreamTrial, StreamTrials, run_stream_accuracy
    from tests.studies.stream_accuracy_table import (
        stream_accuracy_json,
        stream_accuracy_line,
        stream_accuracy_table,
    )
    from tests.studies.vip import chosen_clips
    from tests.studies.vip_suite import VipTrials

    scenes = VipTrials(options.seconds, options.seeds, options.pose_error_deg)
    trials = StreamTrials(scenes, options.lags, options.cameras, options.begins)

    def keep(so_far: tuple[StreamTrial, ...]) -> None:
        note(stream_accuracy_line(so_far[-1]))
        write(stream_accuracy_json(so_far, trials))

    results = run_stream_accuracy(options.motions, trials, tell, chosen_clips(options.kinds, options.clips), keep)
    return stream_accuracy_table(results, trials), stream_accuracy_json(results, trials)


def kaichi(options: KaichiOptions, tell: Tell, write: Callable[[str], None]) -> tuple[str, str]:
    """The tables and the JSON."""
    from tests.studies.kaichi import Form, KaichiTrial, KaichiTrials, Way, run_kaichi
    from tests.studies.kaichi_suite import KaichiScenes
    from tests.studies.kaichi_table import kaichi_json, kaichi_line, kaichi_table
    from tests.studies.vip import chosen_clips

    forms = tuple(Form[name.upper().replace("-", "_")] for name in options.forms)
    ways = tuple(Way[name.upper().replace("-", "_")] for name in options.ways)
    scenes = KaichiScenes(options.seconds, options.seeds, options.pose_error_deg)
    trials = KaichiTrials(scenes, options.imus, forms, ways)
    told = 0

    def keep(so_far: tuple[KaichiTrial, ...]) -> None:
        nonlocal told
        for trial in so_far[told:]:
            note(kaichi_line(trial))
        told = len(so_far)
        write(kaichi_json(so_far, trials))

    results = run_kaichi(options.motions, trials, tell, chosen_clips(options.kinds, options.clips), keep)
    return kaichi_table(results, trials), kaichi_json(results, trials)
