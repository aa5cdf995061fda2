"""Findings are data; their text comes from one table of kinds."""

import string

import pytest

from vip_factors.findings import KINDS, TEXT, Finding, MergedFindings, bare, sentences
from vip_factors.report.page import finding_remarks


def test_a_sentence_has_names_and_numbers() -> None:
    drift = Finding("heading drift", "Ada", numbers={"head": 12.4, "left_foot": -30.0})
    assert str(drift).startswith("wearer 'Ada': headings drifted: head by +12°, left_foot by -30° from the start")
    seen = Finding("shortly seen", "Ada", camera="left", numbers={"seconds": 1.25})
    assert str(seen).startswith("camera 'left': wearer 'Ada' is seen for 1.2 s only")


def test_names_are_no_templates() -> None:
    assert "wearer '{0}' is never seen" in str(Finding("never seen", "{0}"))


@pytest.mark.parametrize("kind", [one for one in KINDS if one != TEXT])
def test_every_kind_says_what_was_found_what_it_means_and_what_to_do(kind: str) -> None:
    one = KINDS[kind]
    assert one.headline
    assert one.means
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
    lying = [Finding("lying", who, numbers={"percent": 90.0}) for who in ("Ada", "Bea")]
    remarks = finding_remarks([*lying, bare("something new"), bare("and more")])
    assert [one.headline for one in remarks] == [KINDS[one].headline for one in ("lying", TEXT, TEXT)]
    assert "Ada" in remarks[0].detail
    assert "Bea" in remarks[0].detail


def test_findings_of_windows_are_told_once() -> None:
    def leap(wearer: str, times: str) -> Finding:
        return Finding("leap", wearer, words={"times": times})

    known = Finding("sensor clock", "Ada", subject="head", numbers={"off_ms": 20.0, "sigma_ms": 2.0})
    known = Finding(known.kind, "Ada", subject="head", numbers=known.numbers, words={"late": "behind", "done": "so"})
    merged = MergedFindings([known])
    merged.add([leap("Ada", "2.00"), Finding("never seen", "Bea"), known], 0.0, 60.0)
    merged.add([leap("Ada", "55.00"), leap("Cem", "56.00")], 54.0, 114.0)
    merged.add([leap("Ada", "110.00")], 108.0, 160.0)
    found = merged.all()
    assert found[0] == known
    told = sentences(sorted(found[1:], key=lambda one: one.wearer))
    assert "leaps in the picture at 2.00 s" in told[0]
    assert told[0].endswith("(from 0 to 60 s, and in 2 more windows)")
    assert told[1].endswith("(from 0 to 60 s)")
    assert "'Cem'" in told[2]
