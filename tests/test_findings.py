"""Findings are data; their text comes from one table of kinds."""

import string

import pytest

from vip_factors.findings import KINDS, TEXT, Finding, FindingLog, bare, sentences
from vip_factors.report.page import finding_remarks


def test_a_sentence_has_names_and_numbers() -> None:
    drift = Finding("heading drift", "Ada", numbers={"head": 12.4, "left_foot": -30.0})
    assert str(drift).startswith("wearer 'Ada': headings drifted: head by +12°, left_foot by -30° from the start")
    scatter = Finding("scatter", "Ada", camera="left", numbers={"scatter": 1.25}, words={"pose": ""})
    assert str(scatter).startswith("camera 'left': wearer 'Ada': the scatter of keypoints about the skeleton is 1.25")


def test_names_are_no_templates() -> None:
    assert "wearer '{0}': the computation" in str(Finding("not converged", "{0}", subject="{1}"))


@pytest.mark.parametrize("kind", [one for one in KINDS if one != TEXT])
def test_every_kind_says_what_was_found_what_it_means_and_what_to_do(kind: str) -> None:
    one = KINDS[kind]
    assert one.headline
    assert one.affects
    assert one.advice
    fields = {name: given for _, name, given, _ in string.Formatter().parse(one.sentence) if name}
    given = {name: 1.0 for name, spec in fields.items() if spec}
    words = {name: f"<{name}>" for name in fields if name not in given}
    told = str(Finding(kind, "Ada", subject="head", numbers=given, words=words))
    assert "{" not in told
    assert all(f"<{name}>" in told for name in words if name not in ("wearer", "subject", "each", "count"))


def test_an_unknown_kind_is_refused_but_read_from_a_file() -> None:
    with pytest.raises(ValueError, match="no kind"):
        Finding("leep")
    assert bare("something new", "of a later version") == Finding(TEXT, text="something new")
    assert str(bare("wearer 'Ada' leaps", "leap")) == "wearer 'Ada' leaps"


def test_findings_of_one_kind_are_one_remark() -> None:
    stuck = [Finding("sensor stuck", who, subject="LS", numbers={"seconds": 9.0}) for who in ("Ada", "Bea")]
    remarks = finding_remarks([*stuck, bare("something new"), bare("and more")])
    assert [one.headline for one in remarks] == [KINDS[one].headline for one in ("sensor stuck", TEXT, TEXT)]
    assert "Ada" in remarks[0].detail
    assert "Bea" in remarks[0].detail


def test_findings_of_windows_are_told_once() -> None:
    def leap(wearer: str, times: str) -> Finding:
        return Finding("leap", wearer, words={"times": times})

    log = FindingLog()
    log.add_window([leap("Ada", "2.00"), Finding("not converged", "Bea")], 0.0, 60.0)
    log.add_window([leap("Ada", "55.00"), leap("Cem", "56.00")], 54.0, 114.0)
    log.add_window([leap("Ada", "110.00")], 108.0, 160.0)
    assert log.take() == ()
    log.close()
    told = sentences(log.take())
    assert "jumps in the image at 2.00 s" in told[0]
    assert told[0].endswith("(from 0 to 60 s, and in 2 more windows)")
    assert told[1].endswith("(from 0 to 60 s)")
    assert "'Cem'" in told[2]


def test_what_is_known_of_the_whole_is_told_of_a_window_only_with_something_more() -> None:
    def wrong(**numbers: float) -> Finding:
        return Finding("accelerometer corrected", "Ada", subject="LS", numbers=numbers, words={"what": str([*numbers])})

    log = FindingLog()
    log.add_window([wrong(gravity=9.0)], 0.0, 60.0, reported=[wrong(gravity=9.0)])
    log.add_window([wrong(clipped=20.0)], 54.0, 114.0, reported=[wrong(gravity=9.0)])
    log.close()
    (told,) = log.take()
    assert told.numbers == {"clipped": 20.0}


def test_what_happens_again_is_counted_until_it_is_due() -> None:
    def told(count: int) -> Finding:
        return bare(f"{count} lost")

    log = FindingLog(10.0)
    for now in (1.0, 2.0, 3.0):
        log.tally("lost", now, told)
    assert sentences(log.take(3.0)) == ("1 lost",)
    assert sentences(log.take(11.0)) == ("2 lost",)
    log.tally("lost", 12.0, told)
    log.close()
    assert sentences(log.take()) == ("1 lost",)


def test_what_happens_to_many_at_once_is_told_together() -> None:
    log = FindingLog(10.0)
    for now in (1.0, 1.1, 1.2):
        log.tally("clock", now, lambda count: bare(f"{count} clocks"), wait=0.3, often=2)
    assert log.take(1.25) == ()
    assert sentences(log.take(1.3)) == ("3 clocks",)
    log.tally("clock", 2.0, lambda count: bare(f"{count} clock"), wait=0.3, often=2)
    assert sentences(log.take(2.3)) == ("1 clock",)
    log.tally("clock", 3.0, lambda count: bare(f"{count} clock"), wait=0.3, often=2)
    assert log.take(12.2) == ()
    assert sentences(log.take(12.3)) == ("1 clock",)
