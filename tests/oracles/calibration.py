"""Independent references for the calibration: white images by brute force."""

from __future__ import annotations

import math

import numpy as np

SUB = 8


def nodes_over(shape, pitch, rotation, layout, origin=(0.0, 0.0)):
    """Every lattice node whose cell touches the image: rotated rows written out, no library code."""
    rows, columns = shape
    reach = int(math.hypot(rows, columns) / pitch) + 4
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    if layout == "square":
        x, y = i * pitch, j * pitch
    else:
        x, y = (i + 0.5 * (j % 2)) * pitch, j * pitch * math.sqrt(3) / 2
    c, s = math.cos(rotation), math.sin(rotation)
    cx = c * x - s * y + (columns - 1) / 2 + origin[0]
    cy = s * x + c * y + (rows - 1) / 2 + origin[1]
    near = (cx > -pitch) & (cx < columns + pitch) & (cy > -pitch) & (cy < rows + pitch)
    return np.stack([cx[near], cy[near]], axis=-1)


def white_image(shape, centres, radius, cut_radius=None, cut_shift=None, noise=0.0, seed=0, envelope=None, light=None):
    """Discs (each cut by a second disc displaced by `cut_shift`), coverage by 8 x 8 sub-samples of edge pixels.

    `light` is the brightness of each disc, 1 where it is not given.
    """
    rows, columns = shape
    image = np.zeros(rows * columns)
    k = math.ceil(radius) + 2
    offset = (np.arange(SUB) + 0.5) / SUB - 0.5
    shift = np.zeros_like(centres) if cut_shift is None else cut_shift
    cut = math.inf if cut_radius is None else cut_radius
    grid_y, grid_x = (g.ravel() for g in np.mgrid[-k : k + 1, -k : k + 1])
    for start in range(0, len(centres), 4000):
        c, t = centres[start : start + 4000], shift[start : start + 4000]
        px = np.round(c[:, :1]) + grid_x
        py = np.round(c[:, 1:]) + grid_y
        dx, dy = px - c[:, :1], py - c[:, 1:]
        first = np.hypot(dx, dy) - radius
        second = np.hypot(dx - t[:, :1], dy - t[:, 1:]) - cut if cut < math.inf else np.full_like(first, -1e9)
        outermost = np.maximum(first, second)
        value = (outermost < 0).astype(float)
        edge = np.abs(outermost) < 0.75
        ex, ey = dx[edge], dy[edge]
        tx, ty = (np.broadcast_to(t[:, n : n + 1], dx.shape)[edge] for n in (0, 1))
        area = np.zeros(ex.shape)
        across, down = (np.square(e + offset[:, None]) for e in (ex, ey))
        aside, below = (np.square(e + offset[:, None] - t) for e, t in ((ex, tx), (ey, ty)))
        for y, y_cut in zip(down, below, strict=True):
            for x, x_cut in zip(across, aside, strict=True):
                inside = x + y < radius**2
                if cut < math.inf:
                    inside &= x_cut + y_cut < cut**2
                area += inside
        value[edge] = area / SUB**2
        if light is not None:
            value *= light[start : start + 4000, None]
        on = (px >= 0) & (px < columns) & (py >= 0) & (py < rows)
        at = (py[on] * columns + px[on]).astype(np.int64)
        image += np.bincount(at, value[on], rows * columns)
    image = image.reshape(shape)
    if envelope is not None:
        image = image * envelope
    if noise:
        image = image + np.random.default_rng(seed).normal(0, noise, shape)
    return image


def stretched_image(shape, centres, along, across, noise=0.0, seed=0):
    """Ellipses of semi-axes `along` the field's radius and `across` it (n,), coverage by 8 x 8 sub-samples."""
    image = np.zeros(shape)
    k = math.ceil(max(along.max(), across.max())) + 1
    offset = (np.arange(SUB) + 0.5) / SUB - 0.5
    grid = np.arange(-k, k + 1)
    middle = (np.array(shape[::-1]) - 1) / 2
    for (x, y), a, b in zip(centres, along, across, strict=True):
        c, s = (np.array([x, y]) - middle) / max(np.hypot(x - middle[0], y - middle[1]), 1e-9)
        dx = (round(x) + grid - x)[None, :, None, None] + offset[None, :]
        dy = (round(y) + grid - y)[:, None, None, None] + offset[:, None]
        value = (((c * dx + s * dy) / a) ** 2 + ((c * dy - s * dx) / b) ** 2 < 1).mean(axis=(2, 3))
        columns, rows = np.meshgrid(round(x) + grid, round(y) + grid)
        on = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
        image[rows[on], columns[on]] += value[on]
    return image + np.random.default_rng(seed).normal(0, noise, shape)


def traced_view(camera, scene, view):
    """Microlens and pixel of a ray through thin lens and pinhole microlens, at 60 digits, from the ray alone.

    `camera` holds f, d_1, d_2, d_3, d, q; `scene` (X, Y, Z) with Z from the main lens; `view` (s', t') the pixel in the
    microlens image, counted from where the ray through the pupil's centre lands. Returns (u, v) with u_0 = 0: found by
    bisecting nothing, since each plane section is linear: two trial pupil points give the line.
    """
    import mpmath as mp

    with mp.workdps(60):
        f, d_1, d_2, d_3, d, q = (mp.mpf(camera[k]) for k in ("f", "d_1", "d_2", "d_3", "d", "q"))
        found = []
        for height, pixel in zip(scene[:2], view, strict=True):
            x, z = mp.mpf(height), mp.mpf(scene[2])

            def land(pupil, x=x, z=z):
                """Height on the array and on the sensor of the ray from the scene point through `pupil` on the FAP."""
                rise = (pupil - x) / (z - d_3)  # towards the lens
                lens = pupil + rise * d_3
                after = rise - lens / f
                array = lens + after * d_1
                return array, array + after * d_2

            def chief(array):
                """Where on the sensor a ray through the FAP's centre lands behind the microlens at `array`."""
                # Rays through the FAP's centre: lens height l, slope l/d_3 before, array at l + (l/d_3 - l/f) d_1.
                if d_3 == 0:
                    return array + array / d_1 * d_2
                unit = 1 + (1 / d_3 - 1 / f) * d_1
                lens = array / unit
                return array + (lens / d_3 - lens / f) * d_2

            def pixel_of(pupil):
                array, sensor = land(pupil)
                return (sensor - chief(array)) / q

            zero, one = pixel_of(mp.mpf(0)), pixel_of(mp.mpf(1))
            pupil = (mp.mpf(pixel) - zero) / (one - zero)
            found.append(float(land(pupil)[0] / d))
        return found


def board_view(camera, rotation, translation, cells, cell, view, u, v, rays=49, print_=None):
    """Picture of a checkerboard in one view, each sample averaged over a lattice of rays that meet the board's plane.

    `camera` holds A, m, d_2, x_0, y_0, q, d; the board's `cells` (across, down) of `cell` mm are centred on its origin,
    on a white sheet one cell wider all round; u, v are the view's samples [pitches]. `print_` is an image of the whole
    board, dark below 128, to draw instead of a checkerboard.
    """
    A, m, d_2, d, q = (camera[k] for k in ("A", "m", "d_2", "d", "q"))
    step = np.array([u[1] - u[0], v[1] - v[0]])
    offsets = (np.outer(np.arange(rays), [1 / rays, (math.sqrt(5) - 1) / 2]) + 0.5 / rays) % 1 - 0.5
    normal = rotation[:, 2]
    pupil = -(q * A / d_2) * np.asarray(view, float)

    def met(uu, vv):
        """Where rays meet the board [cells]."""
        slope_x = -(d * (uu - camera["x_0"]) + m * pupil[0]) / A
        slope_y = -(d * (vv - camera["y_0"]) + m * pupil[1]) / A
        # (pupil + Z slope, Z) - translation lies in the board's plane.
        start = np.array([pupil[0], pupil[1], 0.0]) - translation
        z = -(normal @ start) / (normal[0] * slope_x + normal[1] * slope_y + normal[2])
        x = start[0] + z * slope_x
        y = start[1] + z * slope_y
        depth = start[2] + z
        a = (rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * depth) / cell + cells[0] / 2
        b = (rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * depth) / cell + cells[1] / 2
        return a, b

    def shade(a, b):
        dark = (np.floor(a) + np.floor(b)) % 2 == 0
        if print_ is not None:
            rows, columns = (
                np.clip(np.floor(at * side / count).astype(int), 0, side - 1)
                for at, side, count in ((b, print_.shape[0], cells[1]), (a, print_.shape[1], cells[0]))
            )
            dark = print_[rows, columns] < 128
        on = (a > 0) & (a < cells[0]) & (b > 0) & (b < cells[1])
        paper = (a > -1) & (a < cells[0] + 1) & (b > -1) & (b < cells[1] + 1)
        return np.where(on & dark, 0.08, np.where(paper, 0.9, 0.5))

    uu, vv = np.meshgrid(u, v)
    middle = met(uu, vv)
    picture = shade(*middle)
    # Samples that no edge comes near are of one shade: an edge is nearer than to the next sample along u and along v.
    uneven = np.zeros(picture.shape, bool)
    for at, count in zip(middle, cells, strict=True):
        reach = np.abs(np.diff(at, axis=0)).max() + np.abs(np.diff(at, axis=1)).max()
        inside = (at > -1 - reach) & (at < count + 1 + reach)
        uneven |= inside & (np.abs(at - np.round(at)) < reach if print_ is None else True)
    for at, count in zip(middle, cells, strict=True):
        reach = np.abs(np.diff(at, axis=0)).max() + np.abs(np.diff(at, axis=1)).max()
        uneven &= (at > -1 - reach) & (at < count + 1 + reach)
    uu, vv = uu[uneven], vv[uneven]
    picture[uneven] = sum(shade(*met(uu + ox * step[0], vv + oy * step[1])) for ox, oy in offsets) / rays
    return picture
