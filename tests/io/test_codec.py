"""What is declared of a message and its class is what is written and read."""

from dataclasses import dataclass

import numpy as np
import pytest

from vip_factors.body.anthropometry import LengthPrior
from vip_factors.errors import FileFormatError
from vip_factors.io.codec import Codec
from vip_factors.io.schemas.sensor_placement_pb2 import SensorPlacement
from vip_factors.sensors.calibration import Placement, SensorSite

SITE_OF_SHANK = SensorSite("shank", "left_knee", np.array([0.0, -0.2, 0.03]), np.eye(3), 0.3)


def test_numbers_have_the_shape_that_is_declared() -> None:
    codec = Codec.of_message["vip_factors.LengthPrior"]
    prior = LengthPrior(("thigh", "shank"), np.array([[4e-4, 1e-4], [1e-4, 9e-4]]))
    message = codec.encode(prior)
    np.testing.assert_array_equal(codec.decode(message).covariance, prior.covariance)
    del message.covariance_m2[-1]
    with pytest.raises(FileFormatError, match="LengthPrior has 3 numbers of covariance_m2: expected 4"):
        codec.decode(message)


def test_given_attributes_are_written_and_others_of_the_object_not_read() -> None:
    @dataclass(frozen=True)
    class Named:
        name: str

    codec = Codec(SensorPlacement, Named, {"preset": "name"})
    message = codec.encode(Named("a"), name="b", sites=[SITE_OF_SHANK])
    assert (message.preset, message.sites[0].sensor) == ("b", "shank")
    assert codec.decode(message) == Named("b")


def test_a_declared_field_that_the_message_has_not_is_an_error() -> None:
    with pytest.raises(TypeError, match="SensorPlacement has no pre_set"):
        Codec(SensorPlacement, Placement, {"pre_set": "name"})
