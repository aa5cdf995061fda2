"""The terms of the objective. What sums them, counts them, tests them or hands them to GTSAM takes them from here."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from vip_factors.assembly.equations import Equations, tempered
from vip_factors.assembly.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation

At = TypeVar("At", WearerEvaluation, CameraEvaluation, ViewEvaluation)


@dataclass(frozen=True)
class Term(Generic[At]):
    """One kind of factor.

    Attributes:
        kind: its name, in costs, messages and pictures.
        reach: frames that a factor sees after its first one.
        of_first: the equations of the factors whose first frame lies in a stretch of frames, at a state; nothing if
            there are none.
        every_frame: whether frames repeat what the term says: then each counts by the time that it stands for
            (``frame_share`` of what the term looks at), not once.
    """

    kind: str
    reach: int
    of_first: Callable[[At, slice], Iterator[Equations]]
    every_frame: bool = True

    def equations(self, at: At, first: slice) -> Iterator[Equations]:
        """The equations of the factors whose first frame lies in a stretch, as much as they count."""
        for one in self.of_first(at, first):
            yield tempered(one, at.frame_share(first)) if self.every_frame else one

    def within(self, at: At, frames: slice) -> Iterator[Equations]:
        """The equations of the factors that see any frame of a stretch."""
        first = slice(max(frames.start - self.reach, 0), min(frames.stop, at.frames - self.reach))
        if first.stop > first.start:
            yield from self.equations(at, first)

    def all(self, at: At) -> Iterator[Equations]:
        """The equations of all factors."""
        yield from self.within(at, slice(0, at.frames))
