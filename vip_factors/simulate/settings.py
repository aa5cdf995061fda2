"""What a simulated sensor does wrong: every number has a unit in its name and a reason beside it."""

from dataclasses import dataclass, fields, replace
from typing import Any

from vip_factors.ranges import RangeError, Rate


@dataclass(frozen=True)
class SimulateSettings:
    """Rates and errors of a simulated recording; the defaults are those of :meth:`realistic`.

    Sigmas are standard deviations of normal distributions, per axis where a quantity has axes; 0 switches an error
    off. Where an error stands, physically, matters: the *filter* errors are mistakes of the sensor's attitude
    estimate (its accelerometer does not turn along), the *skin* and *wobble* terms really move the sensor on the
    bone (orientation, specific force and angular rate all follow).
    """

    imu_rate: Rate = 100.0  # Hz; Xsens Awinda sends 60–100 Hz
    truth_rate: float = 60.0  # Hz of the truth motion: the frame rate of TotalCapture and of most video
    phases: bool = True  # sensors sample at their own instants within a period, as unsynchronised ones do
    angular_rate: bool = True  # whether the streams carry a gyroscope
    # Mocap jitter, zero phase, 4th order: the usual gait cutoff, with which walks of the CMU collection have the 3 m/s²
    # at the pelvis that a real sensor shows; at 10 Hz their jitter adds half as much again.
    lowpass_hz: float | None = 6.0

    heading_offset_deg: float = 0.0  # uniform in ±; ask for it: the papers' experiment is ±45
    heading_drift_deg: float = 1.0  # random walk, degrees per √minute: consumer magnetometer-free filters, 1–5
    mounting_error_deg: float = 0.0  # of the placement's mounting; 10–15 for a careless calibration pose
    position_error_m: float = 0.01  # of the placement's position: straps sit a centimetre off the table's place

    filter_heading_deg: float = 2.5  # correlated attitude error about the vertical; data sheets say 1.5–2.5 in motion
    filter_tilt_deg: float = 1.0  # correlated tilt error, each axis; gravity holds it: data sheets say 0.5–1
    filter_time_s: float = 1.5  # correlation time of both: attitude filters average gravity over about a second
    filter_white_deg: float = 0.3  # uncorrelated attitude error, each axis: rounding and time stamps

    skin_deg: float = 2.0  # slow rotation of the sensor on the bone, each axis, at a thigh (see wobble.SEGMENTS)
    skin_m: float = 0.004  # slow shift on the bone, each axis, at a thigh; Leardini et al. 2005 report 5–30 mm
    skin_time_s: float = 0.5  # correlation time: muscles and skin follow the steps
    wobble: float = 1.0  # strength of the sprung response to impacts (see wobble.py); 1 is the natural one
    wobble_tilt_deg_per_cm: float = 4.0  # rocking of the box while it shifts: 1 cm over its 15 cm strap

    acceleration_white: float = 0.3  # m/s² a sample: noise and unmodelled shaking; the bare chip has 0.02–0.05
    acceleration_bias: float = 0.05  # m/s², wandering over bias_time_s; 5 mg is usual without a tumble calibration
    gyro_white_deg_s: float = 0.5  # a sample; MEMS gyroscopes have 0.01 deg/s/√Hz, range and shaking add
    gyro_bias_deg_s: float = 0.1  # after a usual still period
    bias_time_s: float = 100.0  # correlation time of both biases: temperature

    packet_loss: float = 0.002  # share of single samples lost; Awinda indoors
    gap_s: float = 0.25  # length of one longer gap per sensor, when the body blocks the radio

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, bool) or value is None:
                continue
            positive = one.name.endswith(("_rate", "time_s")) or one.name == "lowpass_hz"
            if not (value > 0 if positive else value >= 0):
                wanted = "above 0" if positive else "0 or more"
                raise RangeError(one.name, f"is {value:g}: expected {wanted}")
        if not self.packet_loss < 1:
            raise RangeError("packet_loss", f"is {self.packet_loss:g}: expected a share below 1")

    @classmethod
    def realistic(cls, **changes: Any) -> "SimulateSettings":
        """Body-worn sensors in use: 3–6° orientation error correlated in time, 1–3 m/s² at moving limbs.

        Headings and mountings are right unless asked for: ``realistic(heading_offset_deg=45, mounting_error_deg=10)``.
        """
        return cls(**changes)

    @classmethod
    def noise_free(cls, **changes: Any) -> "SimulateSettings":
        """No error at all, all sensors in step; ``changes`` switches single errors on."""
        kept = {"imu_rate", "truth_rate", "angular_rate", "lowpass_hz", "phases"}
        off = {f.name: 0.0 for f in fields(cls) if f.name not in kept and not f.name.endswith("time_s")}
        return replace(cls(phases=False, **off), **changes)  # type: ignore[arg-type]
