"""Small random recordings and estimates for the tests of files."""

from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from vip_factors.body.anthropometry import LengthPrior, skeleton_from_stature
from vip_factors.body.joint_priors import HINGE_OF, HingeEstimate
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import (
    BodyEstimate,
    PoseCovariance,
    SensorPlaceEstimate,
    WearerEstimate,
)
from vip_factors.geometry.rotations import exp
from vip_factors.sensors.calibration import Placement, SensorCalibration, SensorSite, preset
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, Subject, Truth
from vip_factors.solve.levenberg_marquardt import Iteration, SolveReport

names = st.text(min_size=1, max_size=12)
numbers = st.floats(allow_nan=False, allow_infinity=False)
seeds = st.integers(0, 2**32 - 1)


def rotations(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return exp(rng.normal(size=(*shape, 3)) * rng.choice([1e-9, 0.1, 3.0]))


def stream(rng: np.random.Generator, name: str, N: int, has: tuple[bool, bool, bool] = (True, True, True)) -> ImuStream:
    time = rng.uniform(-1, 100) + np.cumsum(rng.uniform(1e-6, 0.1, N))
    return ImuStream(
        name,
        time,
        rng.normal(scale=20, size=(N, 3)) if has[0] else None,
        rotations(rng, N) if has[1] else None,
        rng.normal(size=(N, 3)) if has[2] else None,
    )


def motion(rng: np.random.Generator, T: int, stature: float = 1.8) -> Motion:
    root = rng.normal(size=(T, 3))
    return Motion(skeleton_from_stature(stature), rotations(rng, T, 24), root, rng.uniform(10, 240), rng.normal(), "me")


def calibration(rng: np.random.Generator, sensors: list[str]) -> dict[str, SensorCalibration]:
    return {
        sensor: SensorCalibration(
            rng.normal(), rotations(rng), abs(rng.normal()), rng.normal(size=3) ** 2, np.arange(5.0), rng.normal(size=5)
        )
        if rng.random() < 0.5
        else SensorCalibration(rng.normal(), rotations(rng))
        for sensor in sensors
    }


def walk(N: int = 200, T: int = 40) -> Recording:
    """A plain recording of six sensors at 100 Hz."""
    rng = np.random.default_rng(3)
    subject = Subject("Ada", 1.7)
    placement = preset("sip6", subject.body())
    imus = {
        site.sensor: ImuStream(site.sensor, np.arange(N) / 100, rng.normal(size=(N, 3)), rotations(rng, N))
        for site in placement.sites
    }
    truth = Truth(motion(rng, T), calibration(rng, list(imus)))
    return Recording("walk", subject, imus, placement, "t-pose", truth, "a walk", 1_700_000_000_123_456_789)


@st.composite
def subjects(draw: st.DrawFn) -> Subject:
    return Subject(
        draw(names),
        draw(st.none() | st.floats(0.8, 2.6)),
        draw(st.none() | st.floats(10, 300)),
        draw(st.none() | st.sampled_from(["male", "female"])),
        draw(st.dictionaries(st.sampled_from(["thigh", "left_forearm", "hip_width"]), st.floats(0.1, 0.6))),
        draw(st.none() | st.floats(1.5, 1.9).map(skeleton_from_stature)),
        draw(st.none() | length_priors()),
        draw(st.sampled_from([(), (hinge_of(np.random.default_rng(draw(seeds)), "right_knee"),)])),
    )


@st.composite
def length_priors(draw: st.DrawFn) -> LengthPrior:
    known = draw(st.lists(st.sampled_from(LENGTHS) | names, max_size=5, unique=True))
    return LengthPrior(tuple(known), covariance(np.random.default_rng(draw(seeds)), len(known)))


def covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    """Of lengths, some millimetres each."""
    root = 0.01 * rng.normal(size=(size, size + 1))
    return root @ root.T


def body(rng: np.random.Generator, known: list[str]) -> BodyEstimate:
    B, hinges = len(known), tuple(hinge_of(rng, "left_elbow") for _ in range(rng.integers(3)))
    posterior = covariance(rng, B) if rng.random() < 0.7 else np.full((B, B), np.nan)
    prior, found = rng.uniform(0.1, 0.5, (2, B))
    return BodyEstimate(tuple(known), prior, found, covariance(rng, B), posterior, hinges, hinges[:1])


def hinge_of(rng: np.random.Generator, joint: str) -> HingeEstimate:
    """Some degrees off."""
    count = len(HINGE_OF[joint].columns)
    return HingeEstimate(joint, 0.05 * rng.normal(size=count), 10 * covariance(rng, count))


def sensor_positions(rng: np.random.Generator, sensors: list[str]) -> tuple[SensorPlaceEstimate, ...]:
    return tuple(
        SensorPlaceEstimate(sensor, "left_knee", *rng.normal(size=(3, 3)), np.full(3, np.nan)) for sensor in sensors
    )


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    rng = np.random.default_rng(draw(seeds))
    sensors = draw(st.lists(names, max_size=3, unique=True))
    has = draw(st.sampled_from([(True, True, True), (True, False, False), (False, True, False), (True, False, True)]))
    imus = {name: stream(rng, name, draw(st.integers(1, 5)), has) for name in sensors}
    sites = tuple(SensorSite(name, "left_knee", rng.normal(size=3), rotations(rng), 0.3) for name in sensors[:2])
    known = draw(st.none() | st.frozensets(st.sampled_from(JOINT_NAMES), min_size=1, max_size=3))
    calibrated = draw(st.sampled_from([None, calibration(rng, sensors)]))
    truth = Truth(motion(rng, draw(st.integers(0, 4))), calibrated, known)
    return Recording(
        draw(names),
        draw(subjects()),
        imus,
        Placement(sites, draw(names)),
        draw(st.sampled_from(["t-pose", "n-pose", "none"])),
        draw(st.sampled_from([None, truth])),
        draw(st.text(max_size=30)),
        draw(st.integers(0, 2**62)),
    )


@st.composite
def estimates(draw: st.DrawFn) -> WearerEstimate:
    rng = np.random.default_rng(draw(seeds))
    sensors = draw(st.lists(names, max_size=3, unique=True))
    T = draw(st.integers(1, 4))
    residuals = {kind: rng.normal(size=(T, len(sensors))) for kind in draw(st.lists(names, max_size=2, unique=True))}
    for values in residuals.values():
        values[rng.random(values.shape) < 0.3] = np.nan
    costs = st.dictionaries(names, numbers, max_size=2)
    iterations = st.builds(Iteration, numbers, numbers, st.booleans(), costs)
    reports = st.builds(SolveReport, names, st.lists(iterations).map(tuple), costs, costs, st.booleans(), numbers)
    return WearerEstimate(
        draw(names),
        draw(names),
        motion(rng, T),
        calibration(rng, sensors),
        PoseCovariance(rng.normal(size=(T, 24, 3, 3)), rng.normal(size=(T, 3, 3))) if draw(st.booleans()) else None,
        residuals,
        tuple(sensors),
        draw(st.lists(reports, max_size=2).map(tuple)),
        draw(st.dictionaries(names, st.text(max_size=10), max_size=3)),
        draw(st.sampled_from([None, body(rng, draw(st.lists(names, max_size=3, unique=True)))])),
        sensor_positions(rng, sensors),
    )


def assert_same(a: object, b: object, where: str = "") -> None:
    """Equal to the bit, but rotations (named ``R_``) to 1e-12."""
    if isinstance(a, np.ndarray):
        assert isinstance(b, np.ndarray), where
        assert a.shape == b.shape, where
        if ".R_" in where:
            np.testing.assert_allclose(a, b, atol=1e-12, err_msg=where)
        else:
            np.testing.assert_array_equal(a, b, err_msg=where)
    elif isinstance(a, dict):
        assert list(a) == list(b) or sorted(a) == sorted(b), where  # type: ignore[call-overload]
        for key, value in a.items():
            assert_same(value, b[key], f"{where}[{key}]")  # type: ignore[index]
    elif isinstance(a, tuple):
        assert len(a) == len(b), where  # type: ignore[arg-type]
        for i, value in enumerate(a):
            assert_same(value, b[i], f"{where}[{i}]")  # type: ignore[index]
    elif hasattr(a, "__dataclass_fields__"):
        assert type(a) is type(b), where
        for name in a.__dataclass_fields__:
            assert_same(getattr(a, name), getattr(b, name), f"{where}.{name}")
    else:
        assert a == b or (a != a and b != b), f"{where}: {a!r} is not {b!r}"


def copy_messages(path: Path, writer: Writer, without: tuple[str, ...] = ("\0",), later_ns: int = 0) -> None:
    """Write the messages of a file, but for topics that begin with one of ``without``, logged later."""
    channels = dict[int, int]()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.topic.startswith(without):
                continue
            if channel.id not in channels:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.id], message.log_time + later_ns, message.data, message.publish_time)
