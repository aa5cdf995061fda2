"""Where sensors and keypoints were found on the bones, as messages and back (place_estimates.proto)."""

from collections.abc import Sequence

import numpy as np

from vip_factors.estimate import DetectorEstimate, SensorPlaceEstimate
from vip_factors.io.mcap_messages import vector, vector_message
from vip_factors.io.schemas.place_estimates_pb2 import DetectorEstimate as DetectorEstimateMessage
from vip_factors.io.schemas.place_estimates_pb2 import SensorPlaceEstimates


def sensor_places_message(places: Sequence[SensorPlaceEstimate]) -> SensorPlaceEstimates:
    """Of one wearer's sensors."""
    message = SensorPlaceEstimates()
    for one in places:
        message.sensors.add(
            sensor=one.sensor,
            bone=one.bone,
            prior_m=vector_message(one.prior),
            found_m=vector_message(one.found),
            prior_sigma_m=vector_message(one.prior_sigma),
            sigma_m=vector_message(one.sigma),
        )
    return message


def sensor_places_of(message: SensorPlaceEstimates) -> tuple[SensorPlaceEstimate, ...]:
    """The places of a message."""
    return tuple(
        SensorPlaceEstimate(
            one.sensor, one.bone, vector(one.prior_m), vector(one.found_m), vector(one.prior_sigma_m),
            vector(one.sigma_m),
        )
        for one in message.sensors
    )  # fmt: skip


def detector_message(detector: DetectorEstimate) -> DetectorEstimateMessage:
    """Where a detector puts its keypoints."""
    message = DetectorEstimateMessage()
    rows = zip(detector.keypoints, detector.prior, detector.found, detector.prior_sigma, detector.sigma, strict=True)
    for name, *vectors in rows:
        prior, found, prior_sigma, sigma = (vector_message(one) for one in vectors)
        message.keypoints.add(keypoint=name, prior_m=prior, found_m=found, prior_sigma_m=prior_sigma, sigma_m=sigma)
    return message


def detector_of(message: DetectorEstimateMessage) -> DetectorEstimate:
    """The detector of a message."""
    vectors = [
        [vector(each) for each in (one.prior_m, one.found_m, one.prior_sigma_m, one.sigma_m)]
        for one in message.keypoints
    ]
    prior, found, prior_sigma, sigma = np.array(vectors, float).reshape(-1, 4, 3).swapaxes(0, 1)
    return DetectorEstimate(tuple(one.keypoint for one in message.keypoints), prior, found, prior_sigma, sigma)
