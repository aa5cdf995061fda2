"""What many recordings cost on a cluster is measured and told."""

import pytest

from tests.studies.many import ManyRecordings, ManyTime
from tests.studies.study import markdown, run


def test_the_table_tells_the_speed_up_and_what_eats_the_rest() -> None:
    one = ManyTime(1, 4, seconds=20.0, working=18.0, command=1.0, scheduler=1.0, own=2.0, children=16.0, alone=12.0)
    two = ManyTime(2, 4, seconds=12.5, working=23.0, command=1.0, scheduler=1.0, own=2.0, children=16.0, alone=12.0)
    assert one.idle == pytest.approx(2.0)
    assert two.idle == pytest.approx(2.0)
    assert two.cores == pytest.approx(1.6)
    told = markdown(ManyRecordings(), [two, one])
    assert "| 2 | 4 | 12.5 | 1.60 | 1.60 |" in told.replace("12.50", "12.5")


@pytest.mark.slow
def test_two_recordings_are_done_by_a_cluster() -> None:
    pytest.importorskip("distributed")
    (row,) = run(ManyRecordings(count=2, seconds=4.0, workers=(1,)))
    assert row.recordings == 2
    assert 0 < row.working < row.seconds
    assert 0 < row.alone < row.children
    assert min(row.command, row.scheduler, row.own) > 0
