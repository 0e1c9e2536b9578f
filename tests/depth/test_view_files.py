"""Files of decoded views: what other programs write, read to the letter; what is none of them, refused in one line."""

import struct

import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat

from roslf_design.calibration import CentreLattice, decode
from roslf_design.calibration.refocusing import focus_stack
from roslf_design.depth.view_files import pfm_bytes, read_pfm, read_views, view_files
from roslf_design.errors import InputError

PARAMETERS = """
[intrinsics]
focal_length_mm = 100.0
image_resolution_x_px = {width}
image_resolution_y_px = {height}
sensor_size_mm = 35.0
fstop = 100.0

[extrinsics]
num_cams_x = {across}
num_cams_y = {down}
baseline_mm = 5.0
focus_distance_m = 0.8
center_cam_rx_rad = 1.5
offset = 1

[meta]
scene = made
disp_min = -1.2
disp_max = 1.6
"""


def texture(x, y):
    return 120 + 40 * np.sin(0.5 * x + 0.2 * y) + 40 * np.sin(0.3 * y - 0.4 * x) * np.cos(0.13 * x)


def write_views(folder, across, down, disparity, size=(44, 60), name="input_Cam{number:03d}.png"):
    """Cameras to the right and below see a point that is near, of positive disparity, further left and up."""
    folder.mkdir(parents=True, exist_ok=True)
    y, x = np.mgrid[: size[0], : size[1]]
    for row in range(down):
        for column in range(across):
            s, t = column - (across - 1) / 2, row - (down - 1) / 2
            shades = texture(x + disparity * s, y + disparity * t)
            file = name.format(number=row * across + column, row=row, column=column)
            Image.fromarray(np.rint(shades).astype(np.uint8)).convert("RGB").save(folder / file)


def test_a_scene_of_the_4d_benchmark_is_sharp_at_its_disparity_and_distance(tmp_path):
    write_views(tmp_path, 5, 3, disparity=0.8)
    (tmp_path / "parameters.cfg").write_text(PARAMETERS.format(width=60, height=44, across=5, down=3))
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(tmp_path / "valid_mask.png")  # other pictures may stand beside
    files = read_views(tmp_path)
    field = files.field
    assert (files.kind, files.missing, field.values.shape) == ("views", 0, (3, 5, 44, 60))
    np.testing.assert_array_equal(field.s, [-2, -1, 0, 1, 2])
    np.testing.assert_array_equal(field.t, [-1, 0, 1])
    assert field.u[0] == -29.5
    picture, weight = field.refocused(-0.8)
    inner = (slice(4, -4), slice(4, -4))
    y, x = np.mgrid[:44, :60]
    # Rounded grey levels (0.3 rms, fewer once averaged) and cubic convolution of a texture of 12 px period.
    np.testing.assert_allclose(picture[inner], texture(x, y)[inner], atol=1.0)
    assert (weight[inner] == 15).all()
    # Disparity in px a view is b f (1/Z - 1/Z_focus), f in px: sensor 35 mm on 60 px, f 100 mm, b 5 mm, focus 0.8 m.
    away = 1 / (1 / 800 + 0.8 / (5 * 100 * 60 / 35))
    assert files.grid.distance(-0.8) == pytest.approx(away, rel=1e-12)
    assert files.grid.slope(away) == pytest.approx(-0.8, rel=1e-12)
    sharpest = max(focus_stack(field, np.arange(-6.0, 7.0), files.grid), key=lambda plane: np.square(
        np.diff(plane.values[inner], axis=1)).sum())  # fmt: skip
    assert sharpest.disparity == 4.0  # five views across
    assert sharpest.distance == pytest.approx(away, rel=1e-12)


def test_views_by_row_and_column_from_any_number_on_with_some_missing(tmp_path):
    write_views(tmp_path, 3, 2, 0.0, name="view_{row:02d}_{column:02d}.png")
    for path in sorted(tmp_path.iterdir()):
        row, column = (int(part) for part in path.stem.split("_")[1:])
        path.rename(tmp_path / f"scene7_{row + 1}_{column + 4}.png")
    (tmp_path / "scene7_2_5.png").unlink()
    files = read_views(tmp_path)
    assert files.field.values.shape == (2, 3, 44, 60)
    assert files.missing == 1
    assert (files.field.weight[1, 1] == 0).all()
    assert (files.field.weight[1, 2] == 1).all()


def test_written_views_come_back_with_what_was_not_measured(tmp_path):
    lattice = CentreLattice((101.3, 80.9), (9.7, 0.1), (-0.1, 9.7), "square")
    y, x = np.mgrid[:170, :210]
    field = decode(3 + 0.02 * x - 0.01 * y, lattice)
    for name, content in view_files(field).items():
        (tmp_path / name).write_bytes(content)
    back = read_views(tmp_path).field
    np.testing.assert_array_equal(back.weight > 0, field.weight > 0)
    assert (field.weight == 0).any()
    np.testing.assert_allclose(back.values, field.values, atol=field.values.max() / 65535)  # 16 bits
    np.testing.assert_array_equal(back.s, field.s)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64])
def test_matlab_light_fields_with_their_weight(tmp_path, kind):
    stored = np.random.default_rng(1).integers(1, 200, (3, 5, 9, 11, 4)).astype(kind)
    stored[0, 0, :, :, 3] = 0
    savemat(tmp_path / "a.mat", {"LF": stored, "note": "x"}, do_compression=kind is np.uint16)
    field = read_views(tmp_path / "a.mat").field
    assert field.values.shape == (3, 5, 9, 11)
    assert field.values[2, 1, 4, 5] == pytest.approx(stored[2, 1, 4, 5, :3].astype(float).mean(), rel=1e-6)
    assert field.weight[2, 1, 4, 5] == pytest.approx(stored[2, 1, 4, 5, 3] / stored[..., 3].max(), rel=1e-6)
    assert (field.values[0, 0] == 0).all()
    savemat(tmp_path / "grey.mat", {"LF": stored[..., 0]})
    np.testing.assert_array_equal(read_views(tmp_path / "grey.mat").field.values, stored[..., 0])


def no_views(place):
    return place, "holds no pictures; views are named by row and column"


def other_names(place):
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(place / "board1.png")
    return place, "holds no views among its 1 pictures"


def two_sizes(place):
    write_views(place, 2, 2, 0.0)
    Image.fromarray(np.zeros((9, 10), np.uint8)).save(place / "input_Cam002.png")
    return place, "input_Cam002.png has 10 x 9 px and input_Cam000.png 60 x 44 px"


def one_twice(place):
    write_views(place, 2, 2, 0.0)
    Image.fromarray(np.zeros((9, 10), np.uint8)).save(place / "input_Cam2.png")
    return place, "are the same view; keep one"


def no_square(place):
    write_views(place, 3, 2, 0.0)
    return place, "6 views are no square grid"


def no_image(place):
    write_views(place, 2, 2, 0.0)
    (place / "input_Cam003.png").write_text("hello")
    return place, "cannot be read as an image"


def too_many(place):
    for row, column in ((0, 0), (9999, 9999)):
        Image.fromarray(np.zeros((9, 10), np.uint8)).save(place / f"view_{row}_{column}.png")
    return place, "10000 x 10000 views of 10 x 9 px are too many"


def wrong_parameters(place):
    write_views(place, 3, 2, 0.0)
    text = PARAMETERS.format(width=60, height=44, across=3, down=2)
    (place / "parameters.cfg").write_text(text.replace("focus_distance_m = 0.8", "focus_distance_m = far"))
    return place, "extrinsics.focus_distance_m: is no positive number: 'far'"


def torn_parameters(place):
    write_views(place, 3, 2, 0.0)
    (place / "parameters.cfg").write_text("num_cams_x = 3")
    return place, "cannot be read"


def no_folder(place):
    return place / "views", "no such folder"


def other_matlab(place):
    savemat(place / "a.mat", {"x": np.zeros((3, 3))})
    return place / "a.mat", "holds no light field LF"


def text_in_matlab(place):
    savemat(place / "a.mat", {"LF": np.array([["a", "b"]], dtype=object)})
    return place / "a.mat", "holds no light field LF"


def cut_matlab(place):
    savemat(place / "a.mat", {"LF": np.random.default_rng(0).random((3, 3, 20, 20))})
    content = (place / "a.mat").read_bytes()
    (place / "a.mat").write_bytes(content[: len(content) // 2])
    return place / "a.mat", "cannot be read as a file of Matlab"


def junk_matlab(place):
    (place / "a.mat").write_text("hello")
    return place / "a.mat", "cannot be read as a file of Matlab"


def hdf_matlab(place):
    (place / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(500))
    return place / "a.mat", "Matlab 7.3 (HDF5); save it again"


def bomb_matlab(place):
    """150 million doubles, fewer than the samples that any file may hold, named in the header alone."""
    savemat(place / "a.mat", {"LF": np.zeros((3, 3, 20, 20))})
    content = (place / "a.mat").read_bytes()
    sizes = [np.array(shape, "<i4").tobytes() for shape in ((3, 3, 20, 20), (10, 10, 1000, 1500))]
    assert content.count(sizes[0]) == 1
    (place / "a.mat").write_bytes(content.replace(*sizes))
    return place / "a.mat", r"LF of 10 x 10 x 1000 x 1500 double numbers is too large (1144 MB; at most 512 MB"


def nan_matlab(place):
    savemat(place / "a.mat", {"LF": np.full((2, 2, 9, 9), np.nan)})
    return place / "a.mat", "not finite"


@pytest.mark.parametrize(
    "spoilt",
    [
        no_views, other_names, two_sizes, one_twice, no_square, no_image, too_many, wrong_parameters, torn_parameters,
        no_folder, other_matlab, text_in_matlab, cut_matlab, junk_matlab, hdf_matlab, bomb_matlab, nan_matlab,
    ],
)  # fmt: skip
def test_what_is_no_light_field_is_refused_by_its_name(tmp_path, spoilt):
    place, said = spoilt(tmp_path)
    with pytest.raises(InputError) as refused:
        read_views(place)
    text = str(refused.value)
    assert said in text
    assert text.startswith(str(tmp_path))
    assert len(text.splitlines()) == 1


def test_disparity_maps_are_stored_from_the_bottom_row_in_either_order_of_bytes(tmp_path):
    rows = [[1.0, -2.5, 3.0], [4.0, float("inf"), 6.0]]
    for scale, order in (("-1.0", "<"), ("1", ">"), ("-0.00392157", "<")):
        content = b"".join(struct.pack(f"{order}3f", *row) for row in rows[::-1])
        (tmp_path / "a.pfm").write_bytes(f"Pf\n3 2\n{scale}\n".encode() + content)
        np.testing.assert_array_equal(read_pfm(tmp_path / "a.pfm"), np.float32(rows))
    (tmp_path / "b.pfm").write_bytes(pfm_bytes(np.array(rows)))
    np.testing.assert_array_equal(read_pfm(tmp_path / "b.pfm"), np.float32(rows))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is no portable float map"),
        (b"P5\n3 2\n255\nabcdef", "is no portable float map"),
        (b"Pf\n3 2\n0\n" + bytes(24), "is no portable float map"),
        (b"Pf\n3 2\nx\n" + bytes(24), "is no portable float map"),
        (b"PF\n3 2\n-1\n" + bytes(72), "a map in colours"),
        (b"Pf\n3 2\n-1\n" + bytes(23), "says 3 x 2 numbers, 24 bytes, and holds 23"),
        (b"Pf\n999999999 999999999\n-1\n" + bytes(8), "and holds 8"),
        (b"Pf\n0 2\n-1\n", "says 0 x 2"),
    ],
)
def test_damaged_disparity_maps_are_refused(tmp_path, content, said):
    (tmp_path / "a.pfm").write_bytes(content)
    with pytest.raises(InputError, match=said):
        read_pfm(tmp_path / "a.pfm")


@pytest.mark.parametrize(
    ("value", "said"), [(1j, "complex numbers"), (1e300, "larger than any"), (np.nan, "not finite")]
)
def test_light_fields_that_no_sensor_gives_are_told(tmp_path, value, said):
    field = np.ones((3, 3, 9, 9), np.asarray(value).dtype)
    field[1, 1, 4, 4] = value
    savemat(tmp_path / "a.mat", {"LF": field})
    with pytest.raises(InputError, match=said):
        read_views(tmp_path / "a.mat")


def test_disparities_that_no_picture_has_are_told(tmp_path):
    (tmp_path / "a.pfm").write_bytes(pfm_bytes(np.array([[np.inf, 1.0], [3e38, np.nan]])))
    with pytest.raises(InputError, match="beyond 1e"):
        read_pfm(tmp_path / "a.pfm")
