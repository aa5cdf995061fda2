"""Is the reported covariance honest (NEES)? On noise as the factors assume it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from tests.studies.gaussian_scene import GaussianScene, GaussianSettings, gaussian_scene
from tests.studies.study import Fixed, Study, Tell, table
from vip_factors.assembly.objective import SceneObjective
from vip_factors.assembly.system import Marginals
from vip_factors.errors import InputError
from vip_factors.evaluate.calibration import nees
from vip_factors.geometry.rotations import Array, log, transpose, wrap_angle
from vip_factors.problem.layout import ROOT, Layout, Owner, OwnerId
from vip_factors.problem.state import CameraState
from vip_factors.problem.variables import camera_owner
from vip_factors.sensors.calibration import PRESETS
from vip_factors.settings import SolveSettings
from vip_factors.simulate.settings import CameraKind
from vip_factors.solve.levenberg_marquardt import levenberg_marquardt
from vip_factors.stages.decode import SharedCovariance

# From the truth, to the last digit: what is asked is whether the covariance is right, not whether the start was good.
TO_THE_END = SolveSettings(max_iterations=50, relative_decrease=1e-9)
JOINTS_AT = 5  # frames of a run at which all joints together are judged


@dataclass(frozen=True)
class SeedConsistency:
    """Mean NEES over dimension of independent runs, and the bounds in which 95 % of honest estimators lie.

    Attributes:
        nees: the mean.
        low, high: of the mean, from the chi-square distribution.
        runs: how many.
    """

    nees: float
    low: float
    high: float
    runs: int

    @property
    def honest(self) -> bool:
        """Whether the mean lies within its bounds."""
        return self.low <= self.nees <= self.high


@dataclass(frozen=True)
class NeesRow:
    """NEES over seeds of one thing that was estimated, with noise of a size."""

    size: float
    of: str
    over_seeds: SeedConsistency


@dataclass(frozen=True, kw_only=True)
class Consistency(Study):
    """Is the reported covariance honest? NEES over seeds, on Gaussian noise."""

    seeds: int = 20
    """Scenes of each size: as many as the bounds need to mean something."""
    camera: CameraKind = "fixed"
    """What films; hand-held and walking are one."""
    # At full size the problem bends within the errors, and a covariance of its linearisation is too small by that; at a
    # quarter of it only mistakes are left to be seen.
    sizes: tuple[float, ...] = (0.25, 1.0)
    """Of the noise, against what the factors suppose."""
    gaussian: Fixed[GaussianSettings] = field(default_factory=GaussianSettings)

    def rows(self, tell: Tell) -> Iterator[NeesRow]:
        for size in self.sizes:
            settings = replace(self.gaussian, moving=self.camera != "fixed", noise=size)
            runs = []
            for seed in range(self.seeds):
                tell(f"noise of size {size:g}", seed / self.seeds)
                runs.append(gaussian_nees(gaussian_scene(settings, seed)))
            for name, dimension in _whole_dimensions(settings).items():
                yield NeesRow(size, name, over_seeds([run[name] for run in runs], dimension))

    def tables(self, rows: Sequence[NeesRow]) -> Iterator[str]:
        yield (
            f"NEES over dimension, {self.camera} camera: 1 is honest, above it the estimator is too sure of itself; "
            "its square root is by how much errors exceed their standard deviations"
        )
        head = ["noise", "of", "seeds", "NEES", "95 % bounds", "within", "errors / sigmas"]
        found = [(row, row.over_seeds) for row in rows]
        yield table(head, [
            [f"{row.size:g} of what is assumed", row.of, one.runs, f"{one.nees:.2f}",
             f"{one.low:.2f} to {one.high:.2f}", "yes" if one.honest else "no", f"{np.sqrt(one.nees):.2f}"]
            for row, one in found
        ])  # fmt: skip


def _whole_dimensions(settings: GaussianSettings) -> dict[str, int]:
    """Dimension of each vector that is judged as a whole, so that its NEES is one chi-square sample."""
    sensors = len(PRESETS[settings.placement])
    return {"headings": sensors, "mountings": 3 * sensors, "camera": 6, "joints": ROOT, "root": 3}


def gaussian_nees(scene: GaussianScene) -> dict[str, Array]:
    """NEES over dimension of one scene, each of all headings, all mountings, the camera, all joints of a frame."""
    objective = SceneObjective(scene.model)
    state, _ = levenberg_marquardt(objective, scene.truth, TO_THE_END)
    marginals, layout = objective.linearise(state).marginals(), objective.layout
    own, true, owner = state.wearers[0], scene.truth.wearers[0], OwnerId(Owner.WEARER)
    headings = SharedCovariance(layout, marginals.static).of(owner, "headings")
    mountings = SharedCovariance(layout, marginals.static).of(owner, "R_bone_sensor")
    chain = layout.chain_of(owner)
    assert headings is not None
    assert mountings is not None
    assert chain is not None
    heading = wrap_angle(true.headings - own.headings)
    mounting = log(transpose(own.R_bone_sensor) @ true.R_bone_sensor).ravel()
    frames = np.unique(np.linspace(0, len(own.p_world_pelvis) - 1, JOINTS_AT).astype(int))
    of_frames = marginals.chains[chain][frames]
    joints = log(transpose(own.R_parent_child[frames]) @ true.R_parent_child[frames]).reshape(len(frames), -1)
    root = (true.p_world_pelvis - own.p_world_pelvis)[frames]
    return {
        "headings": nees(heading[None], headings[None]),
        "mountings": nees(mounting[None], mountings[None]),
        "camera": _camera_nees(layout, state.cameras[0], scene.truth.cameras[0], marginals, frames),
        "joints": nees(joints, of_frames[:, :ROOT, :ROOT]),
        "root": nees(root, of_frames[:, ROOT:, ROOT:]),
    }


def _camera_nees(
    layout: Layout, camera: CameraState, truth: CameraState, marginals: Marginals, frames: np.ndarray,
) -> Array:  # fmt: skip
    R = camera.poses.R_world_camera
    turn = log(transpose(R) @ truth.poses.R_world_camera)
    shift = np.einsum("tji,tj->ti", R, truth.poses.p_world_camera - camera.poses.p_world_camera)
    tangent = np.concatenate([turn, shift], axis=1)
    path = layout.chain_of(camera_owner(0))
    if path is None:
        standing = SharedCovariance(layout, marginals.static).of(camera_owner(0), "poses")
        assert standing is not None
        return nees(tangent, standing[None])
    return nees(tangent[frames], marginals.chains[path][frames])


def nees_bounds(dimension: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Between which the mean over ``runs`` independent NEES (each over its ``dimension``) lies with this probability.

    ``runs · dimension · mean`` is chi-square with ``runs · dimension`` degrees of freedom (Bar-Shalom 5.4.2).
    """
    if runs < 1 or dimension < 1:
        raise InputError(f"NEES bounds of {runs} runs of dimension {dimension}: expected at least one of each")
    freedom = runs * dimension
    tail = (1 - level) / 2
    return float(chdtri(freedom, 1 - tail) / freedom), float(chdtri(freedom, tail) / freedom)


def over_seeds(values: Sequence[Array], dimension: int) -> SeedConsistency:
    """Mean of the NEES of several runs, one array each.

    Errors within a run hang together (frames follow each other, sensors share a camera), so a run counts once: the
    bounds are those of as many samples as there are runs with a finite value.
    """
    means = [float(np.mean(one[np.isfinite(one)])) for one in map(np.asarray, values) if np.any(np.isfinite(one))]
    low, high = nees_bounds(dimension, len(means))
    return SeedConsistency(float(np.mean(means)), low, high, len(means))
