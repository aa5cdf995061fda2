"""Settings of the report."""

from dataclasses import dataclass

from vip_factors.errors import InputError


@dataclass(frozen=True)
class ReportSettings:
    """How much goes into the page.

    Attributes:
        rate: Hz, of the motion to turn around; as many frames as the estimate has at most.
        most_poses: frames times bodies that the page holds: of longer recordings the motion is shown at a lower rate.
        moments: how many of the least certain moments get a picture.
    """

    rate: float = 30.0  # as films: faster is not seen, and would double the file
    most_poses: int = 9000  # 2.4 MB in the page: five minutes of one wearer at 30 Hz
    moments: int = 4  # a row or two of pictures: 60 kB each

    def __post_init__(self) -> None:
        if not self.rate > 0:
            raise InputError(f"rate {self.rate} Hz: expected a positive number")
        if self.most_poses < 2:
            raise InputError(f"most poses {self.most_poses}: expected two at least")
        if self.moments < 0:
            raise InputError(f"moments {self.moments}: expected none or more")
