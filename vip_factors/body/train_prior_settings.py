"""How the pose prior is trained."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PriorTraining:
    """How frames become a Gaussian."""

    rate: float = 4.0  # Hz: poses a quarter of a second apart are nearly independent in a walk
    longest_clip: float = 10.0  # s: a longer clip counts no more than this, lest one long take set the prior
    minimum_sigma_deg: float = 5.0  # added in quadrature: rest poses differ by as much between sources
    minimum_toe_sigma_deg: float = 10.0  # few sources move the toes, which bend at every step
    minimum_collar_sigma_deg: float = 8.0  # nor the clavicles, which rise with a lifted arm by up to 30 degrees
    # Forearms turn by ±80°, in the wrist of most sources; with a bent elbow that shows in the elbow's x and z. Which
    # way the elbow bends is the hinge factor's to say.
    minimum_pronation_sigma_deg: float = 30.0
    shrinkage: float = 0.1  # correlations shrink by this, so that no combination is forbidden for not having been seen
    largest_violation_deg: float = 15.0  # of a joint limit: a frame beyond is a conversion gone wrong, and is dropped
