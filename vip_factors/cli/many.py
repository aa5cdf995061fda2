"""One command over many recordings: folders, globs and lists in, an output each, and one summary of all.

What is there already is kept, so that a run that was interrupted goes on where it was; a file that cannot be used costs
itself alone. Files may be anywhere that fsspec reaches: workers fetch what they need, and put what they made in place
whole.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from queue import Empty, Queue
from tempfile import TemporaryDirectory
from typing import Any

import tyro

from vip_factors.cli.many_tasks import MANY, RunOptions, Task, joined, leading, storage_of, tasks_of
from vip_factors.cli.options import FAILED as DOUBTED
from vip_factors.cli.terminal import say
from vip_factors.cli.workers import SIGNAL, Future, Worker, Workers, run_child, workers
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.findings import Severity
from vip_factors.ranges import RangeError, check_ranges
from vip_factors.report.overview import FAILED, Row, write_overview

TRIES = 2  # of a recording whose process was killed, or ran out of memory
DONE, THERE = "done", "there already"


def main(command: str, prog: str, words: Sequence[str]) -> int:
    """Run a command over many files; what fails is told, and the rest goes on.

    Returns:
        The worst exit code.

    Raises:
        InputError: for options that it does not know, or where there is nothing to work on.
    """
    given = leading(words)
    options, rest = tyro.cli(RunOptions, prog=prog, args=words[len(given) :], return_unknown_args=True)
    try:
        check_ranges(options)
    except RangeError as wrong:
        raise InputError(f"--{wrong.name} {wrong.reason}") from wrong
    tasks = list(tasks_of(command, prog, given, options, rest))
    summary = _summary_path(command, options, given)
    rows, begun = [_existing_row(task) for task in tasks if _is_there(task)], time.monotonic()
    there = {row.input for row in rows}
    waiting = [task for task in tasks if task.source not in there]
    try:
        for row in _worked(waiting, options, len(rows), len(tasks)):
            rows.append(row)
    finally:
        order = {task.source: number for number, task in enumerate(tasks)}
        rows.sort(key=lambda row: order[row.input])
        if rows:
            write_overview(f"vip-factors {command}", rows, summary)
    failed = [row for row in rows if row.error]
    say(
        f"{len(rows)} files in {time.monotonic() - begun:.0f} s: {sum(row.state == DONE for row in rows)} done, "
        f"{sum(row.state == THERE for row in rows)} there already, {len(failed)} failed"
    )
    counts = [(level, sum(row.weight == level for row in rows)) for level in map(str, Severity)]
    say("verdicts: " + ", ".join(f"{count} {level.upper()}" for level, count in counts if count) or "none")
    for path in (summary, summary.with_suffix(".html")):
        say(path)
    return max((row.exit_code for row in rows), default=0)


def _is_there(task: Task) -> bool:
    """Whether all is there: outputs appear whole. A format of one person has a file for each of several."""
    return not task.overwrite and all(_made(output) for output in task.outputs)


def _made(output: str) -> str:
    if storage_of(output).exists():
        return output
    stem, dot, suffix = output.rpartition(".")
    each = [] if output.endswith((".mcap", ".json", ".html")) else storage_of(f"{stem}.*{dot}{suffix}").glob()
    return next(iter(each), "")


def _existing_row(task: Task) -> Row:
    """The row of what is there already."""
    estimate = task.source if MANY[task.command].reads_estimates else task.outputs[0]
    known = {} if "://" in estimate else _facts(Path(estimate))
    return _limited(Row(task.source, task.outputs[0], THERE, **known), task)


def _limited(row: Row, task: Task) -> Row:
    bad = task.limit != "never" and bool(row.verdict) and Severity(row.weight).reaches(Severity(task.limit))
    return replace(row, exit_code=DOUBTED) if bad else row


def _facts(path: Path) -> dict[str, Any]:
    """Of an estimate's file: its verdict, findings and frames; nothing of one that cannot be read."""
    from vip_factors.io.mcap_estimate import read_head

    try:
        head, frames = read_head(path)
    except (VipFactorsError, OSError):
        return {}
    return {"verdict": str(head.verdict), "findings": tuple(map(str, head.all_findings)), "frames": frames}


def _worked(tasks: Sequence[Task], options: RunOptions, done: int, count: int) -> Iterator[Row]:
    """The rows of tasks as they end; what was killed is tried once more, by another worker if there is one."""
    from vip_factors.cli.terminal import StatusLine

    if not tasks:
        return
    ended: Queue[Future] = Queue()
    with workers(options.jobs, options.cluster) as all_workers, StatusLine() as line:
        left, failed, begun = dict[Any, tuple[Task, int]](), 0, time.monotonic()
        for task in tasks:
            left[_submit(all_workers, task, ended)] = task, 1
        while left:
            line.show(_progress_text(done, count, failed, time.monotonic() - begun, len(tasks) - len(left)))
            try:
                future = ended.get(timeout=1.0)
            except Empty:
                continue
            task, tries = left.pop(future)
            row = _row_of(future, task)
            if row.exit_code > SIGNAL and tries < TRIES:
                line.note(f"note: {row.input}: {row.error}; once more")
                left[_submit(all_workers, task, ended, row.worker)] = task, tries + 1
                continue
            done, failed = done + 1, failed + bool(row.error)
            if row.error:
                line.note(f"note: {row.input}: {row.error}")
            yield row


def _submit(all_workers: Workers, task: Task, ended: "Queue[Future]", other_than: str = "") -> Future:
    future = all_workers.submit(work, task, other_than)
    future.add_done_callback(ended.put)
    return future


def _progress_text(done: int, count: int, failed: int, seconds: float, ended: int) -> str:
    from vip_factors.cli.terminal import duration

    left = f", {duration(seconds / ended * (count - done))} left" if ended else ""
    return f"{done} of {count} files, {failed} failed{left} ({duration(seconds)})"


def _row_of(future: Future, task: Task) -> Row:
    try:
        return future.result()
    except Exception as error:  # of the cluster: a worker that is lost again and again, say
        sentence = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return Row(task.source, task.outputs[0], FAILED, 1, error=sentence)


def work(worker: Worker, task: Task) -> Row:
    """Do a task, in a process of its own; what it makes appears whole, or not at all."""
    begun = time.monotonic()
    if _is_there(task):  # whoever was lost had come to the end
        return replace(_existing_row(task), worker=worker.name)
    row = Row(task.source, task.outputs[0], FAILED, 2, worker=worker.name)
    try:
        with TemporaryDirectory(prefix="vip-factors-") as folder:
            row = _worked_in(Path(folder), worker, task, row)
    except (VipFactorsError, OSError) as error:
        row = replace(row, error=" ".join(str(error).split()))
    return replace(_limited(row, task), seconds=time.monotonic() - begun)


def _worked_in(folder: Path, worker: Worker, task: Task, row: Row) -> Row:
    kind, made = MANY[task.command], folder / "made"
    made.mkdir()
    (folder / "read").mkdir()
    source = storage_of(task.source).fetched(folder / "read")
    words, settings = list(task.words), folder / "settings.toml"
    for name, text in task.texts.items():
        settings.write_text(text, encoding="utf-8")
        words = [word.replace(name, str(settings)) if word.endswith(name) else word for word in words]
    targets = [made / PurePosixPath(output).name for output in task.outputs]
    for target in targets:
        words += [kind.output, str(target)] if kind.output else []
    first = [str(source), *([] if kind.output else map(str, targets))]
    if task.companion:
        words += [kind.companion, str(storage_of(task.companion).fetched(folder / "read"))]
    ended = run_child(worker, [task.command, *first, *words], folder)
    if ended.code not in (0, DOUBTED):
        return replace(row, exit_code=ended.code, error=ended.sentence)
    known = _facts(source if kind.reads_estimates else targets[0])
    for one in sorted(made.iterdir()):
        storage_of(joined(task.outputs[0].rpartition("/")[0] or ".", one.name)).put(one)
    evaluation = ended.out.partition("\n")[0] if task.command == "evaluate" else ""
    return replace(row, state=DONE, exit_code=ended.code, evaluation=evaluation, **known)


def _summary_path(command: str, options: RunOptions, given: Sequence[str]) -> Path:
    """The table's file; beside the outputs if those are in a folder here, else in this folder."""
    if options.summary is not None:
        return options.summary.with_suffix(".csv")
    folder = options.out or next((one for one in given if Path(one).is_dir()), ".")
    return Path("." if "://" in folder else folder) / f"{command}.summary.csv"
