"""The focal length in the metadata of videos."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.io.video import focal_from_metadata

KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
av = pytest.importorskip("av")


def film(path: Path, equivalent: str | None) -> Path:
    with av.open(path, "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata["com.apple.quicktime.make"] = "Apple"
        if equivalent is not None:
            container.metadata[KEY] = equivalent
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        image = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        for packet in (*stream.encode(image), *stream.encode()):
            container.mux(packet)
    return path


@pytest.mark.parametrize("suffix", ["mov", "mp4"])
@pytest.mark.parametrize("size", [(1920, 1080), (1080, 1920)])
def test_a_phone_states_its_focal_length(tmp_path: Path, suffix: str, size: tuple[int, int]) -> None:
    wide, tele = (film(tmp_path / f"{mm}.{suffix}", mm) for mm in ("13", "77"))
    focal = focal_from_metadata(wide, *size)
    assert focal is not None
    assert 80 < 2 * np.rad2deg(np.arctan(960 / focal)) < 110  # an ultra-wide lens of 120° across the diagonal, cropped
    assert focal_from_metadata(tele, *size) == pytest.approx(77 / 13 * focal)


@pytest.mark.parametrize("equivalent", [None, "0", "many"])
def test_files_that_do_not_state_it(tmp_path: Path, equivalent: str | None) -> None:
    assert focal_from_metadata(film(tmp_path / "a.mov", equivalent), 1920, 1080) is None


def test_damaged_files_state_nothing(tmp_path: Path) -> None:
    content = film(tmp_path / "a.mov", "26").read_bytes()
    damaged = tmp_path / "b.mov"
    for end in range(0, len(content), 97):
        damaged.write_bytes(content[:end])
        assert focal_from_metadata(damaged, 1920, 1080) in (None, pytest.approx(1587, abs=1))
