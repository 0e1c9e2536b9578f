"""Names of captures, and bench.toml as it is written and read."""

import pytest

from roslf_design.bench.captures import BenchCapture, BoardTarget
from roslf_design.errors import InputError


@pytest.mark.parametrize(
    ("name", "kind", "ahead"),
    [
        ("calibration/white_1.tif", "white", None),
        ("calibration/White.png", "white", None),
        ("calibration/dark_2.tif", "dark", None),
        ("calibration/board_01.tif", "board", None),
        ("acceptance/edge_40mm.tif", "edge", 40.0),
        ("acceptance/wall_7.5mm_2.tif", "wall", 7.5),
    ],
)
def test_names_tell_kinds(tmp_path, name, kind, ahead):
    assert BenchCapture.named(tmp_path / name)[1:] == (kind, ahead)


def test_a_name_of_no_kind_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"edge_40mm\.tif"):
        BenchCapture.named(tmp_path / "acceptance/edge.tif")


def test_a_bar_that_was_measured_corrects_sizes():
    board = BoardTarget(bar=100.0, printed_bar=99.8, cells="charuco 8x6 6 mm 4 mm DICT_4X4_50").board
    assert board.cell == pytest.approx(5.988)
    assert board.markers.width == pytest.approx(3.992)
