"""Files of raw images: stacks, arrays and packed pixels come back as they were, by one reader for all commands."""

import numpy as np
import pytest
import tifffile
from PIL import Image

import roslf_design as roslf
from roslf_design.calibration import CalibrationError
from roslf_design.calibration.frames import read_capture, read_image
from roslf_design.calibration.raw import from_raw, full_scale
from roslf_design.input_files import read_frames

RNG = np.random.default_rng(3)


def mono12p(pixels):
    """GenICam's Mono12p: a stream of bits, lowest first, without gaps; the last byte filled up."""
    bits = (pixels.ravel()[:, None] >> np.arange(12)) & 1
    return np.packbits(bits.astype(np.uint8).ravel(), bitorder="little").tobytes()


def mono12packed(pixels):
    """GigE Vision's Mono12Packed: high eight bits of one, low four of it under low four of the next, high eight."""
    flat = [int(value) for value in pixels.ravel()] + [0] * (pixels.size % 2)
    out = bytearray()
    for one, other in zip(flat[::2], flat[1::2], strict=True):
        out += bytes([one // 16, one % 16 + 16 * (other % 16), other // 16])
    return bytes(out)


@pytest.mark.parametrize(("name", "pack"), [("a.mono12p", mono12p), ("a.mono12packed", mono12packed)])
@pytest.mark.parametrize("shape", [(10, 14), (9, 13)], ids=["even", "odd"])
def test_packed_pixels_come_back(tmp_path, name, pack, shape):
    frames = RNG.integers(0, 4096, (3, *shape), dtype=np.uint16)
    (tmp_path / "raw.toml").write_text(f"width = {shape[1]}\nheight = {shape[0]}\n")
    (tmp_path / name).write_bytes(pack(frames[0]))
    np.testing.assert_array_equal(read_image(tmp_path / name), frames[0])
    (tmp_path / name).write_bytes(b"".join(pack(frame) for frame in frames))
    np.testing.assert_array_equal(read_frames(tmp_path / name, name)[0], frames)


def test_packed_pixels_without_their_sizes_are_refused(tmp_path):
    path = tmp_path / "a.mono12p"
    path.write_bytes(mono12p(np.arange(100).reshape(10, 10)))
    for text, said in (
        (None, "needs raw.toml beside it.*no such file"), ("width = 10", "height: is None"), ("width = ", "is no TOML"),
        ('width = "10"\nheight = 10', "width: is 10"), ("width = 10\nheight = 11", "150 bytes, and 10 x 11 px"),
    ):  # fmt: skip
        if text is not None:
            (tmp_path / "raw.toml").write_text(text)
        with pytest.raises(CalibrationError, match=said):
            read_image(path)


def test_stacks_and_arrays_are_read_alike(tmp_path):
    frames = RNG.integers(0, 4000, (5, 20, 30), dtype=np.uint16)
    tifffile.imwrite(tmp_path / "pages.tif", frames)
    tifffile.imwrite(tmp_path / "loose.tif", frames, metadata=None)
    tifffile.imwrite(tmp_path / "imagej.tif", frames, imagej=True)
    np.save(tmp_path / "stack.npy", frames)
    np.save(tmp_path / "big.npy", frames.astype(">u2"))
    for name in ("pages.tif", "loose.tif", "imagej.tif", "stack.npy", "big.npy"):
        np.testing.assert_array_equal(read_frames(tmp_path / name, name)[0], frames)
        np.testing.assert_array_equal(read_image(tmp_path / name), np.rint(frames.mean(0)).astype(np.uint16))
    np.save(tmp_path / "one.npy", frames[0] / 7)
    np.testing.assert_array_equal(read_image(tmp_path / "one.npy"), frames[0] / 7)
    colours = RNG.integers(0, 255, (20, 30, 3), dtype=np.uint8)
    tifffile.imwrite(tmp_path / "planes.tif", np.moveaxis(colours, -1, 0), photometric="rgb", planarconfig="separate")
    np.save(tmp_path / "colours.npy", colours)
    Image.fromarray(colours).save(tmp_path / "colours.png")
    for name in ("planes.tif", "colours.npy", "colours.png"):
        np.testing.assert_array_equal(read_image(tmp_path / name), colours)


def test_arrays_that_are_none_are_refused(tmp_path):
    path = tmp_path / "a.npy"
    for array in (np.zeros(9), np.zeros((2, 2, 9, 9, 9)), np.array([object()]), np.array(["text"] * 4).reshape(2, 2)):
        np.save(path, array, allow_pickle=True)
        with pytest.raises(CalibrationError, match=r"a.npy (cannot be read as an image|is no image)"):
            read_image(path)
    path.write_bytes(b"\x93NUMPY nothing")
    with pytest.raises(CalibrationError, match=r"a.npy cannot be read"):
        read_image(path)


def test_white_images_and_dark_frames_are_averaged(tmp_path):
    """Of several exposures the brightest that are not saturated; saturation of one frame stays in the mean."""
    base = RNG.integers(1000, 1400, (20, 30)).astype(np.uint16)
    for number in range(4):
        tifffile.imwrite(tmp_path / f"white_{number}.tif", base + number)
    tifffile.imwrite(tmp_path / "white_half.tif", base // 2)
    tifffile.imwrite(tmp_path / "white_full.tif", np.full_like(base, 4095))
    np.save(tmp_path / "dark_1.npy", np.stack([base // 100, base // 100 + 2]))
    tifffile.imwrite(tmp_path / "board_1.tif", base)
    found = read_capture(tmp_path)
    assert [path.name for path in found.boards] == ["board_1.tif"]
    assert [group.count for group in found.whites] == [4, 1, 1]
    np.testing.assert_array_equal(found.white, np.rint(base + 1.5))
    np.testing.assert_array_equal(found.dark, base // 100 + 1)
    np.testing.assert_allclose(found.whites[0].squares, 5.0)
    tifffile.imwrite(tmp_path / "white.tif", base)
    with pytest.raises(CalibrationError, match=r"white.tif and white_0.tif are both there"):
        read_capture(tmp_path)


def test_all_commands_read_them(tmp_path):
    """A raw image as counts in a stack, an array and packed: views of all are the same."""
    nodes = np.add.outer(np.arange(72) % 13 - 6.0, np.zeros(72)) ** 2
    white = np.where(nodes + nodes.T < 36, 2000.0, 30.0).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", np.stack([white, white]))
    np.save(tmp_path / "a.npy", white)
    (tmp_path / "raw.toml").write_text("width = 72\nheight = 72\n")
    (tmp_path / "a.mono12p").write_bytes(mono12p(white))
    told = roslf.decode(str(tmp_path / "a.mono12p"), str(tmp_path / "a.npy"), design="paper", focus=["0"])
    assert np.isfinite(told.field.values).all()
    for name in ("a.tif", "a.npy"):
        other = from_raw(tmp_path / name, tmp_path / "a.npy", None, roslf.load("paper"), lambda _: None)
        np.testing.assert_array_equal(other.field.values, told.field.values)


def test_a_full_pixel_counts_from_the_black_level():
    white, dark = np.full((4, 4), 3000, np.uint16), np.full((4, 4), 120, np.uint16)
    assert full_scale(white, {}, 12, None) == 4095
    assert full_scale(white, {}, 12, None, dark) == 4095 - 120
    assert full_scale(white, {}, 10, None, dark) == 65535 - 120
    assert full_scale(white, {"full_well": 2.0}, 12, None, dark) == 2.0
