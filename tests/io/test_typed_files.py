"""Files that people write: wrong values are told with their place, and what fills the memory is refused before."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from limited_memory import limited_memory

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.body_file import read_body_file
from vip_factors.io.camera_file import read_camera_file
from vip_factors.io.detections import read_keypoint_offsets
from vip_factors.io.importers.column_guess import guess
from vip_factors.io.importers.column_map import read_column_map
from vip_factors.io.importers.text_table import read_text_table
from vip_factors.io.placement_file import placement_from_file
from vip_factors.io.typed_files import Number, Vector, read_json, read_toml


class Lamp(msgspec.Struct, forbid_unknown_fields=True):
    watts: Number
    place: Vector = (0, 0, 0)


class Street(msgspec.Struct, forbid_unknown_fields=True):
    lamps: list[Lamp]
    name: str | None = None
    trees: dict[str, dict[str, Lamp | str]] = {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lamps = [{ watts = 'many' }]", r"lamps\[0\]\.watts: expected number, got text in quotes"),
        ("lamps = [{ watts = true }]", r"lamps\[0\]\.watts: expected number, got true or false"),
        ("lamps = [{ watts = nan }]", r"lamps\[0\]\.watts: expected number"),
        (f"lamps = [{{ watts = 1{'0' * 400} }}]", r"lamps\[0\]\.watts: number out of range"),
        ("lamps = [{ watts = 1, place = [1, 2] }]", r"lamps\[0\]\.place: expected list of length 3, got 2"),
        ("lamps = [{}]", r"lamps\[0\]\.watts is missing"),
        ("lamps = 3", "lamps: expected list, got whole number"),
        ("lamps = []\nname = 3", "name: expected text in quotes, got whole number"),
        ("lamps = []\nnam = 'x'", "unknown key 'nam'; did you mean 'name'"),
        ("lamps = []\n[trees]\na.b = 'x'\noak.c = 'x'\noak.d.watts = 'y'", r"trees\.oak\.d\.watts: expected number"),
        ("lamps = []\n[trees]\noak.c = 3", r"trees\.oak\.c: expected text in quotes or table, got whole number"),
        ("lamps = [", "expected a street"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "street.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"street\.toml: .*{words}"):
        read_toml(path, Street, "a street")


def test_toml_and_json_are_alike_and_a_mark_before_the_text_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("\ufeffname = 'x'\nlamps = [{ watts = 3 }]", encoding="utf-8")
    (tmp_path / "a.json").write_text('\ufeff{"name": "x", "lamps": [{"watts": 3}]}', encoding="utf-8")
    street = read_toml(tmp_path / "a.toml", Street, "a street")
    assert street == read_json(tmp_path / "a.json", Street, "a street") == Street([Lamp(3.0)], "x")


LONG_KEYS = [
    "a" + ".a" * 50_000 + " = 1",
    "[" + "a . " * 50_000 + "a]",
    "'a'" + '."b"' * 50_000 + " = 1",
    "x = { a" + ".a" * 50_000 + " = 1 }",
]
READERS = (read_body_file, read_camera_file, read_column_map, read_keypoint_offsets, placement_from_file)


@pytest.mark.parametrize("text", LONG_KEYS, ids=range(len(LONG_KEYS)))
def test_a_key_of_many_parts_is_refused_before_it_fills_the_memory(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(f"# first line\n{text}\n")
    for read in READERS:
        with limited_memory(2**28), pytest.raises(FileFormatError, match=r"a\.toml, line 2: a key of more than 16"):
            read(path)


def test_sentences_with_dots_are_no_keys(tmp_path: Path) -> None:
    text = "... a.b.c and d.e.f ... " * 20
    (tmp_path / "a.toml").write_text(f'name = "{text}"\nlamps = []  # {text}\n')
    assert read_toml(tmp_path / "a.toml", Street, "a street").name == text


@pytest.mark.parametrize(
    ("name", "text", "read"),
    [
        ("a.toml", "[sensors]\n" + "".join(f'n{i} = "pelvis"\n' for i in range(200_000)), placement_from_file),
        ("a.toml", "[sensors]\n" + "".join(f'n{i} = "pelvis"\n' for i in range(20_000)), placement_from_file),
        ("a.toml", "x = " + "[" * 400_000, read_camera_file),
        ("a.json", '{"camera_matrix": ' + "[" * 400_000, read_camera_file),
        ("a.yaml", "%YAML:1.0\n---\na: " + "[" * 400_000, read_camera_file),
        ("a.yaml", "%YAML:1.0\n---\na: " + "{a: " * 200_000, read_camera_file),
        ("a.yaml", "%YAML:1.0\n---\n" + "a:" * 400_000, read_camera_file),
        ("a.yaml", "%YAML:1.0\n---\nb:\n  " + "-" * 400_000, read_camera_file),
        ("a.xml", "<opencv_storage>" + "<a>" * 200_000, read_camera_file),
        ("a.yaml", "%YAML:1.0\n---\ncamera_matrix: [" + "1," * 300_000 + "1]", read_camera_file),
        ("a.csv", ",".join(["t", *(f"s{i}_acc_x" for i in range(1_000_000))]) + "\n0,0,0\n1,0,0\n", read_text_table),
        ("a.csv", "t,a\n" + ("0.5," * 1_000_000 + "1\n") * 4, guess),
        ("a.sto", "endheader\n" + "time\t" * 1_000_000 + "\n" + "0\t" * 1_000_000 + "\n", read_text_table),
    ],
    ids=lambda value: getattr(value, "__name__", str(value)[:30]),
)
def test_what_is_too_large_or_too_deep_is_refused_in_a_sentence(
    tmp_path: Path, name: str, text: str, read: Callable[[Path], object]
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with limited_memory(2**28), pytest.raises(InputError, match=name) as refused:
        read(path)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value).replace(str(path), "")) < 400
