"""Live messages to the same set-up and samples, and senders that err."""

from io import BytesIO

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from live_sender import delimited, live_messages, sample_message
from live_streams import assert_arrived, short_walk, sorted_out
from scene_samples import scenes

from vip_factors.errors import FileFormatError, RecordingError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.live_messages import Client, ClientError, Session, header_message, rotation_of, setup_of
from vip_factors.io.live_open import delimited_messages, follow
from vip_factors.io.schemas.geometry_pb2 import QuaternionWxyz
from vip_factors.io.schemas.live_message_pb2 import LiveHeader, LiveMessage
from vip_factors.sensors.live import ImuSample, LiveItem, VideoFrame, stream_head
from vip_factors.sensors.scene import Scene


class Received:
    """A session without a source."""

    def __init__(self) -> None:
        self.put: list[LiveItem | Scene] = []
        self.session = Session(self.put.append)

    def client(self) -> Client:
        return Client(self.session, "a client")

    def taken(self, *messages: LiveMessage) -> "Received":
        client = self.client()
        for message in messages:
            client.take(message.SerializeToString())
        client.leave()
        return self

    @property
    def setups(self) -> list[Scene]:
        return [item for item in self.put if isinstance(item, Scene)]

    @property
    def items(self) -> list[LiveItem]:
        return [item for item in self.put if not isinstance(item, Scene)]

    @property
    def samples(self) -> list:  # type: ignore[type-arg]
        return sorted_out(self.items)[0]

    @property
    def sentences(self) -> list[str]:
        return sorted_out(self.items)[1]


HEADER = header_message(stream_head(short_walk()))
WALK = [delimited(message) for message in live_messages(short_walk())]


def header() -> LiveMessage:
    copy = LiveMessage()
    copy.CopyFrom(HEADER)
    return copy


def heard(data: bytes) -> tuple[Received, str]:
    """What arrives of a stream of bytes, and why it ended."""
    got = Received()
    client = got.client()
    reason = follow(client, BytesIO(data))
    client.leave(reason)
    return got, reason


@settings(max_examples=25)
@given(scenes())
def test_a_scene_arrives_as_it_was_sent(scene: Scene) -> None:
    try:
        stream_head(scene)
    except RecordingError:
        assume(False)  # a wearer called as the camera
    got, reason = heard(b"".join(map(delimited, live_messages(scene))))
    assert reason == ""
    assert got.sentences == []
    assert_arrived(scene, got.setups[0], got.samples)


@settings(max_examples=40)
@given(st.integers(0))
def test_a_truncated_stream_gives_what_came_and_one_finding(kept: int) -> None:
    data = b"".join(WALK)
    got, reason = heard(data[: kept % len(data)])
    whole = np.cumsum([len(one) for one in WALK]) <= kept % len(data)
    assert len(got.samples) == max(0, int(whole.sum()) - 1)
    assert len(got.sentences) == (1 if reason else 0)
    assert bool(reason) == (kept % len(data) not in np.cumsum([len(one) for one in WALK]))


@settings(max_examples=40)
@given(st.data())
def test_any_message_of_the_schema_gives_a_sample_or_a_finding(data: st.DataObject) -> None:
    numbers, texts = st.floats(), st.text(max_size=5)
    message = LiveMessage(carrier=data.draw(texts))
    if data.draw(st.booleans()):
        message.imu.sensor = data.draw(texts)
        for part in data.draw(st.sets(st.sampled_from(["seconds", "timestamp", "orientation_wxyz", "specific_force"]))):
            if part == "seconds":
                message.imu.seconds = data.draw(numbers)
            elif part == "timestamp":
                message.imu.timestamp.seconds = data.draw(st.integers(-(2**63), 2**63 - 1))
            else:
                of = getattr(message.imu, part)
                of.SetInParent()
                of.x, of.y = data.draw(numbers), data.draw(numbers)
    else:
        message.detections.seconds = data.draw(numbers)
        for _ in range(data.draw(st.integers(0, 3))):
            sizes = data.draw(st.sampled_from([(34, 17), (0, 0), (34, 16), (2, 1)]))
            message.detections.people.add(pixels=[1.0] * sizes[0], confidence=[0.5] * sizes[1])
    got = Received().taken(header(), message)
    assert len(got.items) == 1


@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3), st.floats(0.96, 1.04)
)
def test_the_quick_rotation_is_the_tested_one(q: list[float], scale: float) -> None:
    wxyz = np.array(q) / np.linalg.norm(q) * scale
    found = rotation_of(QuaternionWxyz(**dict(zip("wxyz", wxyz.tolist(), strict=True))))
    np.testing.assert_allclose(found, matrix_from_quaternion(wxyz, Order.WXYZ), atol=1e-14)


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (2, 0, 0, 0), (float("nan"), 0, 0, 1), (1e300, 1e300, 0, 0)])
def test_the_quick_rotation_refuses_what_the_tested_one_does(q: tuple[float, ...]) -> None:
    assert rotation_of(QuaternionWxyz(w=q[0], x=q[1], y=q[2], z=q[3])) is None


def test_unknown_carriers_and_sensors_are_passed_on() -> None:
    frame = VideoFrame("drone", 0.1, np.ones((1, 3, 2)), np.ones((1, 3)))
    got = Received().taken(header(), sample_message(ImuSample("Bob", "tail", 1.0)), sample_message(frame))
    assert [sample.carrier for sample in got.samples[:1]] == ["Bob"]
    assert got.samples[1].camera == "drone"
    assert got.samples[1].pixels.shape == (1, 3, 2)
    assert got.sentences == []


def test_without_a_carrier_the_first_wearer_and_camera_count() -> None:
    message, frame = LiveMessage(), LiveMessage()
    message.imu.sensor, message.imu.timestamp.seconds = "head", 1_700_000_001
    frame.detections.timestamp.seconds = 1_700_000_002
    got = Received().taken(header(), message, frame)
    assert got.samples[0].carrier == "Ada"
    assert got.samples[0].time == pytest.approx(1 - 0.123456789, abs=1e-9)
    assert got.samples[1].camera == "phone"
    assert got.samples[1].time == pytest.approx(2 - 0.123456789, abs=1e-9)


def test_a_flood_of_one_mistake_is_told_once() -> None:
    bad = sample_message(ImuSample("Ada", "head", 1.0))
    bad.imu.orientation_wxyz.SetInParent()
    got = Received().taken(header(), *[bad] * 500)
    assert got.samples == []
    assert len(got.sentences) <= 3
    assert "no unit quaternion" in got.sentences[0]
    assert "498 more" in got.sentences[-1]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda header: header.ClearField("wearers"), "has no wearer"),
        (lambda header: setattr(header.wearers[0], "initial_pose", "sitting"), "expected t-pose, n-pose, none"),
        (lambda header: setattr(header.cameras[0], "calibration", b"\xff"), "no foxglove.CameraCalibration"),
        (lambda header: header.cameras[0].ClearField("calibration"), "camera matrix K"),
        (lambda header: header.cameras[0].info.ClearField("keypoints"), "names no keypoints"),
        (lambda header: setattr(header.cameras[0].info, "name", "Ada"), "two wearers or cameras are called Ada"),
        (lambda header: header.wearers[0].placement.sites[0].ClearField("mounting_wxyz"), "unit length"),
        (lambda header: setattr(header.wearers[0].subject, "stature_m", 17.0), "17"),
    ],
)
def test_an_unusable_header_is_refused(change, complaint: str) -> None:  # type: ignore[no-untyped-def]
    bad = header()
    change(bad.header)
    got = Received()
    with pytest.raises(ClientError, match="its header cannot be used") as caught:
        got.taken(bad)
    assert complaint in str(caught.value)
    got.taken(header())
    assert len(got.setups) == 1


def test_the_next_client_must_describe_the_same_and_its_clock_is_moved_onto_the_first() -> None:
    later, other = header(), header()
    later.header.start.seconds += 10
    other.header.wearers[0].subject.name = "Bob"
    got = Received().taken(header())
    got.taken(later, sample_message(ImuSample("Ada", "head", 1.0)))
    assert got.samples[0].time == 11.0
    with pytest.raises(ClientError, match="other wearers"):
        got.taken(other)


def test_a_preset_without_sites_is_fitted_to_the_body() -> None:
    message = LiveHeader(name="short")
    wearer = message.wearers.add()
    wearer.subject.name, wearer.subject.stature_m, wearer.placement.preset = "Ada", 1.6, "sip6"
    found = setup_of(message).wearers[0]
    assert [site.sensor for site in found.placement.sites][:2] == ["head", "pelvis"]
    assert found.initial_pose == "none"


@given(st.text(max_size=300))
def test_it_is_the_usual_delimited_form(carrier: str) -> None:
    reference = pytest.importorskip("google.protobuf.proto", reason="Protobuf before 5.28 has none to compare with")
    message, stream = LiveMessage(carrier=carrier), BytesIO()
    reference.serialize_length_prefixed(message, stream)
    assert delimited(message.SerializeToString()) == stream.getvalue()


def test_a_length_beyond_the_limit_is_refused_before_its_bytes_come() -> None:
    with pytest.raises(FileFormatError, match="16,777,217 bytes is announced: expected at most 16,777,216"):
        list(delimited_messages(BytesIO(b"\x81\x80\x80\x08")))
