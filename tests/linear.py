"""Linear systems written out, for comparison."""

import gtsam
import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.factor_graph.graph import FactorGraph
from vip_factors.problem.layout import Owner, OwnerId
from vip_factors.problem.state import SceneState


def dense(objective: SceneObjective, state: SceneState) -> tuple[np.ndarray, np.ndarray]:
    """Hessian and gradient at a state: frames, then what they share, each heading that drifts behind the one before."""
    system, names = objective.linearise(state), shared_names(objective)
    place_of = {name: index for index, name in enumerate(names)}
    W, T = objective.layout.frame_width, objective.problem.frames
    end = (T + 2) * W  # of frames, with two that are none
    H, g = np.zeros((end + len(names), end + len(names))), np.zeros(end + len(names))

    def places(columns: np.ndarray, frame: int) -> np.ndarray:
        return end + np.array([place_of[name] for name in named(objective, columns, frame)], int)

    for group in objective.groups:
        w, s = group.shape.frame, group.shape.static
        for stretch, (band,) in zip(group.stretches, system.bands([group], group.stretches), strict=True):
            shared = places(group.static, stretch.start)
            for i, (row, gradient) in enumerate(zip(band.rows, band.gradient, strict=True)):
                own = W * (stretch.start + i) + group.frame
                H[np.ix_(own, own)] += np.triu(row[:, :w])
                for ahead in range(1, 3 if group.shape.tied else 1):
                    block = row[:, ahead * w : (ahead + 1) * w]
                    if block.any():
                        H[np.ix_(own, own + W * ahead)] += block
                H[np.ix_(own, shared)] += row[:, row.shape[1] - s :]
                g[own] += gradient
            H[np.ix_(shared, shared)] += np.triu(band.static)
            g[shared] += band.static_gradient
            if stretch.stop < T:
                columns, sigmas, differences = system._heading_steps(group, stretch.stop)
                old, new = (places(group.static[columns], frame) for frame in (stretch.stop - 1, stretch.stop))
                H[old, old] += sigmas**-2.0
                H[new, new] += sigmas**-2.0
                H[old, new] -= sigmas**-2.0
                g[old] -= sigmas**-2.0 * differences
                g[new] += sigmas**-2.0 * differences
    nothing = slice(T * W, end)
    assert not H[nothing].any()
    assert not H[:, nothing].any()
    kept = np.concatenate([np.arange(T * W), np.arange(end, len(H))])
    H = H[np.ix_(kept, kept)]
    return np.triu(H) + np.triu(H, 1).T, -g[kept]


def shared_names(objective: SceneObjective) -> list[tuple[int, int]]:
    """Of the columns of what frames share: that in the static vector, and which of the headings it is."""
    found = []
    for owner, block, columns in objective.layout.placed:
        if block.free:
            drifts = block.name == "headings" and objective.problem.wearers[owner.number].headings_drift
            count = len(objective.problem.wearers[owner.number].heading_times) if drifts else 1
            found += [(column, step) for step in range(count) for column in range(columns.start, columns.stop)]
    return found


def named(objective: SceneObjective, columns: np.ndarray, frame: int) -> list[tuple[int, int]]:
    """The names of some columns of the static vector in a frame."""
    steps = dict.fromkeys(columns.tolist(), 0)
    for number, wearer in enumerate(objective.problem.wearers):
        if wearer.headings_drift:
            own = objective.layout.columns(OwnerId(Owner.WEARER, number), "headings").tolist()
            step = int(wearer.heading_numbers(slice(frame, frame + 1))[0])
            steps |= {column: step for column in own if column in steps}
    return list(steps.items())


def dense_of_graph(whole: FactorGraph) -> tuple[np.ndarray, np.ndarray]:
    """The same of a GTSAM graph at its values, in the order of its variables."""
    ordering = gtsam.Ordering()
    for variable in whole.variables:
        ordering.push_back(variable.key)
    return whole.graph.linearize(whole.values).hessian(ordering)


def assert_same(ours: tuple[np.ndarray, np.ndarray], theirs: tuple[np.ndarray, np.ndarray]) -> None:
    (H, g), (expected_H, expected_g) = ours, theirs
    scale = np.sqrt(np.outer(np.diag(expected_H), np.diag(expected_H)))
    np.testing.assert_allclose(H / scale, expected_H / scale, atol=1e-9)
    np.testing.assert_allclose(g, expected_g, atol=1e-9 * np.abs(expected_g).max())
