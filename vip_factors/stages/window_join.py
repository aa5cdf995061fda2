"""Solved windows joined into one motion without seams.

Two windows overlap. At its ends a window knows less than all frames together do, by what lies beyond; within some steps
that fades. In the middle of an overlap both are settled: there one passes over into the other.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vip_factors.estimate import PoseCovariance, WearerEstimate
from vip_factors.geometry.rotations import Array, exp, log, transpose
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.stages.window_solve import SolvedWindow

SETTLING = 0.4  # of an overlap, at either end, is left to a window to settle; in between they meet


def joined(windows: Iterator[SolvedWindow], model: WearerProblem, head: WearerEstimate) -> Iterator[WearerEstimate]:
    """The estimate chunk by chunk; each ends where the next window takes over.

    Args:
        windows: overlapping, in the order of time.
        model: of the wearer.
        head: the estimate without its frames.
    """
    axes = slice(0, 2 if model.has_floor else 3)  # in which a window does not know where it is
    done, before = 0, next(windows)
    for window in windows:
        first, last = window.frames.start, before.frames.stop
        settled = int((last - first) * SETTLING)
        meeting = slice(first + settled, last - settled)
        window = _moved(window, before, meeting, axes)
        yield _chunk(_passing_over(before, window, meeting), slice(done, meeting.stop), head)
        done, before = meeting.stop, window
    yield _chunk(before, slice(done, before.frames.stop), head)


def _moved(window: SolvedWindow, before: SolvedWindow, meeting: slice, axes: slice) -> SolvedWindow:
    """A window moved to where the one before it is, as sure of where that is."""
    own, other = _within(window, meeting), _within(before, meeting)
    shift = np.zeros(3)
    shift[axes] = np.mean(other.state.p_world_pelvis - own.state.p_world_pelvis, axis=0)[axes]
    state, covariance = replace(window.state, p_world_pelvis=window.state.p_world_pelvis + shift), window.covariance
    if covariance is not None and own.covariance is not None and other.covariance is not None:
        root, middle = covariance.root.copy(), len(own.covariance.root) // 2
        root[:, axes, axes] += (other.covariance.root - own.covariance.root)[middle, axes, axes]
        covariance = replace(covariance, root=root)
    return replace(window, state=state, covariance=covariance)


def _passing_over(before: SolvedWindow, window: SolvedWindow, meeting: slice) -> SolvedWindow:
    """The window before, which in the frames of the meeting passes over into the next one."""
    own, other = _within(before, meeting), _within(window, meeting)
    share = np.linspace(0, 1, meeting.stop - meeting.start + 2)[1:-1]
    ends = slice(None, meeting.start - before.frames.start)
    cut = _within(before, slice(before.frames.start, meeting.start))
    covariance = cut.covariance
    if covariance is not None and own.covariance is not None and other.covariance is not None:
        covariance = PoseCovariance(
            *(
                np.concatenate([kept, _between(one, two, share)])
                for kept, one, two in (
                    (covariance.joints, own.covariance.joints, other.covariance.joints),
                    (covariance.root, own.covariance.root, other.covariance.root),
                )
            )
        )
    met = _states_between(own.state, other.state, share)
    state = replace(
        before.state,
        R_parent_child=np.concatenate([before.state.R_parent_child[ends], met.R_parent_child]),
        p_world_pelvis=np.concatenate([before.state.p_world_pelvis[ends], met.p_world_pelvis]),
    )
    nearer = (share < 0.5)[:, None]
    residuals = {
        kind: np.concatenate([cut.residuals[kind], np.where(nearer, own.residuals[kind], other.residuals[kind])])
        for kind in before.residuals
    }
    return replace(
        before, frames=slice(before.frames.start, meeting.stop), state=state, covariance=covariance, residuals=residuals
    )


def _states_between(one: WearerState, other: WearerState, share: Array) -> WearerState:
    turn = share[:, None, None] * log(transpose(one.R_parent_child) @ other.R_parent_child)
    return replace(
        one,
        R_parent_child=one.R_parent_child @ exp(turn),
        p_world_pelvis=_between(one.p_world_pelvis, other.p_world_pelvis, share),
    )


def _between(one: Array, other: Array, share: Array) -> Array:
    return one + share.reshape(-1, *(1,) * (one.ndim - 1)) * (other - one)


def _within(window: SolvedWindow, frames: slice) -> SolvedWindow:
    """Some of a window's frames."""
    own = slice(frames.start - window.frames.start, frames.stop - window.frames.start)
    covariance = window.covariance
    return replace(
        window,
        frames=frames,
        state=window.state.window(own),
        covariance=None if covariance is None else PoseCovariance(covariance.joints[own], covariance.root[own]),
        residuals={kind: values[own] for kind, values in window.residuals.items()},
    )


def _chunk(window: SolvedWindow, frames: slice, head: WearerEstimate) -> WearerEstimate:
    own, motion = _within(window, frames), head.motion
    R, p_world = own.state.R_parent_child, own.state.p_world_pelvis
    start = motion.start + frames.start / motion.rate
    motion = replace(motion, R_parent_child=R, p_world_pelvis=p_world, start=start)
    return replace(head, motion=motion, covariance=own.covariance, residuals=own.residuals, reports=window.reports)
