"""Every sentence that the package can say about a recording has a meaning in plain words, and one only."""

import ast
from pathlib import Path

import pytest

import vip_factors
from vip_factors.report.advice import remarks_of
from vip_factors.report.finding_meanings import MEANINGS, UNKNOWN, meaning_of

PACKAGE = Path(vip_factors.__file__).parent
SHORTEST = 40  # characters: what is shorter in these modules is part of a sentence
MODULES = (
    "associate/findings.py", "pipeline.py", "stages/calibration_start.py", "stages/drift.py", "stages/findings.py",
    "stages/reporting.py", "stages/sensor_checks.py", "stages/wearer_findings.py",
)  # fmt: skip
# How others begin: an error, what told who is who, and parts of sentences.
NOT_FINDINGS = (
    "extra factors among several wearers",
    "0 was told by motion in",
    "a T- or N-pose held",
    "check which sensor sits where",
)


class Sentences(ast.NodeVisitor):
    """Texts with ``0`` for what is filled in; docstrings, errors and parts of other texts are not among them."""

    def __init__(self, constants: dict[str, str]) -> None:
        self.found: list[str] = []
        self._constants = constants

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        pass

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str):
            self.found.append(node.value)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        self.found.append("".join(self._text(one) for one in node.values))

    def _text(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            return str(node.value)
        assert isinstance(node, ast.FormattedValue)
        return self._constants.get(getattr(node.value, "id", ""), "0")


def said() -> list[str]:
    sentences = []
    for name in MODULES:
        tree = ast.parse((PACKAGE / name).read_text(encoding="utf-8"))
        assigned = [(one.targets[0], one.value) for one in tree.body if isinstance(one, ast.Assign)]
        constants = {
            target.id: value.value
            for target, value in assigned
            if isinstance(target, ast.Name) and isinstance(value, ast.Constant) and isinstance(value.value, str)
        }
        visitor = Sentences(constants)
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.Assign):
                visitor.visit(node)
        sentences += [one for one in visitor.found if len(one) >= SHORTEST and " " in one]
    return [one for one in sentences if not one.startswith(NOT_FINDINGS)]


@pytest.mark.parametrize("sentence", said())
def test_every_sentence_has_one_meaning(sentence: str) -> None:
    kinds = [one.kind for one in MEANINGS if one.words in sentence]
    assert len(kinds) == 1, f"'{sentence}': expected one kind in report/finding_meanings.py, found {kinds}"


def test_every_meaning_is_of_a_sentence() -> None:
    sentences = said()
    assert len(sentences) >= len(MEANINGS)
    for one in MEANINGS:
        assert any(one.words in sentence for sentence in sentences), f"nobody says '{one.words}'"


def test_every_module_with_findings_is_looked_at() -> None:
    """A new function that yields sentences is to be added to MODULES."""
    for path in sorted((*PACKAGE.glob("stages/*.py"), *PACKAGE.glob("associate/*.py"))):
        name = path.relative_to(PACKAGE).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Yield) and isinstance(node.value, ast.JoinedStr):
                assert name in MODULES, f"{name}, line {node.lineno}: a sentence that this test does not know"


def test_sentences_of_one_kind_are_one_remark() -> None:
    lying = [f"wearer '{who}' lies, or bends far over, in 90 % of the frames: if not, check" for who in ("Ada", "Bea")]
    remarks = remarks_of([*lying, "something new"])
    assert [one.headline for one in remarks] == [meaning_of(lying[0]).headline, UNKNOWN.headline]
    assert "Ada" in remarks[0].detail
    assert "Bea" in remarks[0].detail
