"""What a picture of a factor graph shows, as plain words and numbers: of any graph, whatever kinds it is made of."""

from dataclasses import dataclass


@dataclass(frozen=True)
class VariableKind:
    """All variables of one kind.

    Attributes:
        kind: its name.
        count: how many there are in the graph.
        shared: whether all frames share them; else each frame has its own.
    """

    kind: str
    count: int
    shared: bool


@dataclass(frozen=True)
class FactorKind:
    """All factors of one kind.

    Attributes:
        kind: its name.
        count: how many there are in the graph.
        reach: frames that one of them spans; 0 if it sees only what all frames share.
        sees: kinds of the variables that they see.
        runs: first and last frame of each run of frames in which one of them begins.
    """

    kind: str
    count: int
    reach: int
    sees: tuple[str, ...]
    runs: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class FrameVariable:
    """A variable of the frame that is drawn in full, or one that all frames share.

    Attributes:
        kind: of it.
        owner: whose: a wearer's name, or the camera.
        label: of which sensor or joint, in words; empty of what there is one of.
        joint: index in the skeleton; None of what is no joint's.
        bone: index of the one that its sensor is strapped to; None of what is no such sensor's.
        shared: whether all frames share it.
        of_the_body: whether it is a wearer's; else the camera's.
    """

    kind: str
    owner: str
    label: str = ""
    joint: int | None = None
    bone: int | None = None
    shared: bool = False
    of_the_body: bool = True


@dataclass(frozen=True)
class FrameFactors:
    """Factors of one kind that see the same variables in the frame that is drawn in full: one square.

    Attributes:
        kind: of them.
        sees: indices of the frame's variables; of a chain of joints the last one only.
        count: how many they are.
    """

    kind: str
    sees: tuple[int, ...]
    count: int = 1


@dataclass(frozen=True)
class GraphDescription:
    """A factor graph to be drawn.

    Attributes:
        name: of the recording or scene.
        wearers: their names; the first one is drawn in full.
        frames: how many there are.
        seconds: from the first frame to the last.
        frame: index of the one that is drawn in full.
        frame_seconds: its time since the first frame.
        variable_kinds, factor_kinds: of the whole graph, in the order of their colours.
        variables: of the frame, and those that all frames share.
        factors: that see these alone.
    """

    name: str
    wearers: tuple[str, ...]
    frames: int
    seconds: float
    frame: int
    frame_seconds: float
    variable_kinds: tuple[VariableKind, ...]
    factor_kinds: tuple[FactorKind, ...]
    variables: tuple[FrameVariable, ...]
    factors: tuple[FrameFactors, ...]
