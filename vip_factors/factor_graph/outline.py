"""A factor graph described for a picture: its kinds and counts, and one of its frames in full."""

from collections import Counter
from collections.abc import Iterable, Sequence

from vip_factors.body.skeleton import JOINT_NAMES, ancestors
from vip_factors.errors import InputError
from vip_factors.factor_graph.graph import FactorGraph
from vip_factors.factor_graph.term_factors import TermFactor
from vip_factors.factor_graph.variables import JOINT, ROOT, Variable
from vip_factors.problem.layout import Owner
from vip_factors.problem.variables import ROWS
from vip_factors.viz.graph_picture import FactorKind, FrameFactors, FrameVariable, GraphDescription, VariableKind


def graph_description(
    graph: FactorGraph, name: str, wearers: Sequence[str], frame: int | None = None
) -> GraphDescription:
    """Describe a graph of wearers, in its order; ``frame`` is the index of the one described in full, the middle one if
    None.

    Raises:
        InputError: for a frame that the graph does not have.
    """
    frames = len(graph.time)
    frame = frames // 2 if frame is None else frame
    if not 0 <= frame < frames:
        raise InputError(f"frame {frame}: the graph has frames 0 to {frames - 1}; choose one of them")
    outline = _Outline(graph, wearers, frame)
    return GraphDescription(
        name,
        tuple(wearers),
        frames,
        float(graph.time[-1] - graph.time[0]),
        frame,
        float(graph.time[frame] - graph.time[0]),
        outline.variable_kinds(),
        outline.factor_kinds(),
        tuple(outline.described(one) for one in outline.numbers),
        outline.frame_factors(),
    )


class _Outline:
    """One graph and one of its frames; ``numbers`` are those of the variables that the frame is drawn with."""

    def __init__(self, graph: FactorGraph, wearers: Sequence[str], frame: int) -> None:
        self.graph, self.wearers, self.frame = graph, wearers, frame
        drawn = (one for one in graph.variables if self._is_drawn(one))
        self.numbers = {one: number for number, one in enumerate(drawn)}

    def _of_a_frame(self, one: Variable) -> bool:
        return one.is_of_a_frame or (one.is_of_the_camera_path and self.graph.problem.camera.moving)

    def _is_drawn(self, one: Variable) -> bool:
        """A heading that walks is drawn once, whatever its knots."""
        here = one.frame == self.frame or not self._of_a_frame(one)
        return here and one.wearer == 0 and one.knot == 0

    def variable_kinds(self) -> tuple[VariableKind, ...]:
        shared = {one.kind: not self._of_a_frame(one) for one in self.graph.variables}
        return tuple(VariableKind(kind, n, shared[kind]) for kind, n in self.graph.variable_counts.items())

    def factor_kinds(self) -> tuple[FactorKind, ...]:
        by_kind: dict[str, list[TermFactor]] = {}
        for one in self.graph.factors:
            by_kind.setdefault(one.kind, []).append(one)
        return tuple(self._factor_kind(kind, those) for kind, those in by_kind.items())

    def _factor_kind(self, kind: str, those: Sequence[TermFactor]) -> FactorKind:
        sees: dict[str, None] = {}  # in their order
        reach, begins = 0, set()
        for one in those:
            sees.update((variable.kind, None) for variable in one.variables)
            frames = self._frames(one)
            if frames:
                reach = max(reach, max(frames) - min(frames) + 1)
                begins.add(min(frames))
        return FactorKind(kind, len(those), reach, tuple(sees), _runs(begins))

    def _frames(self, factor: TermFactor) -> set[int]:
        """The frames whose own variables a factor sees; a camera that stands still is no frame's."""
        return {one.frame for one in factor.variables if self._of_a_frame(one)}

    def described(self, one: Variable) -> FrameVariable:
        """A variable in words."""
        wearers, camera = self.graph.problem.wearers, one.owner.kind is Owner.CAMERA
        label, joint, bone = "", None, None
        if one.block == JOINT:
            label, joint = JOINT_NAMES[one.item], one.item
        elif one.block in ROWS and ROWS[one.block].of_sensors:
            label = wearers[one.wearer].frames.sensors[one.item]
            bone = int(wearers[one.wearer].sensors[one.item].bone)
        owner = "camera" if camera else self.wearers[one.wearer]
        return FrameVariable(
            one.kind, owner, label.replace("_", " "), joint, bone, not self._of_a_frame(one), not camera
        )

    def frame_factors(self) -> tuple[FrameFactors, ...]:
        found: Counter[tuple[str, tuple[int, ...]]] = Counter()
        for factor in self.graph.factors:
            if self._frames(factor) <= {self.frame}:
                seen = [self._first_knot(one) for one in factor.variables]
                if all(one in self.numbers for one in seen):
                    found[factor.kind, self._tips(seen)] += 1
        return tuple(FrameFactors(kind, sees, count) for (kind, sees), count in found.items())

    def _first_knot(self, one: Variable) -> Variable:
        return Variable(one.block, one.wearer, one.frame, one.item)

    def _tips(self, seen: Sequence[Variable]) -> tuple[int, ...]:
        """Of a chain of joints from the pelvis, and the root below it, only the last joint; all else as it is."""
        joints = {one.item for one in seen if one.block == JOINT}
        last = max(joints, default=0)  # children come after their parents
        if joints and joints == set(ancestors(last)):
            seen = [one for one in seen if one.block != ROOT]
            seen = [one for one in seen if one.block != JOINT or one.item == last]
        return tuple(dict.fromkeys(self.numbers[one] for one in seen))


def _runs(frames: Iterable[int]) -> tuple[tuple[int, int], ...]:
    """First and last of each run of neighbouring frames."""
    runs: list[tuple[int, int]] = []
    for frame in sorted(frames):
        if runs and frame == runs[-1][1] + 1:
            runs[-1] = runs[-1][0], frame
        else:
            runs.append((frame, frame))
    return tuple(runs)
