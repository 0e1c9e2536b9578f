"""Microlens images: one on its pixels with the rims that cut it, by rays or by waves; and whole raw images."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..._arrays import Array
from ...bore.opening import ClearAperture
from ...camera import Camera
from ...drawing.marks import (
    Area,
    Disc,
    Dots,
    Image,
    Key,
    Line,
    Mark,
    Point,
    Text,
    box_key,
    dot_key,
    line_key,
    parted,
    xy,
)
from ...drawing.panel import Panel, Scale, colour_bar
from ...drawing.picture import PAGE, Picture, beside, legend_height
from ...drawing.theme import PLAIN, SMALL, drawn_in, short, stop_colour
from ...effects import plan
from ...evaluation.fields import field_openings
from ...imaging.camera import ImageLattice, planned_camera
from ...imaging.transfer import encircled
from ...imaging.white import harmonic_series, white_patch
from ...shapes.coverage import LARGEST_PART, LARGEST_RADIUS
from ...shapes.lattice import Lattice, cell_polygon, lens_centres, nearest_lens
from ...shapes.openings import Openings
from ...theory.exit_pupil import microlens_image_diameter, microlens_image_pitch
from ...theory.stop_images import MicrolensImages
from ...theory.transfer import MicrolensTransfer
from ...words import percent

if TYPE_CHECKING:
    from ...design import Design
    from ...imaging.render import RawImage

UM = 1e3
LEFT, TOP, RIGHT, BELOW = 58.0, 42.0, 12.0, 42.0
"""Margins [px]."""
GRID_UP_TO = 60
"""Pixels across a picture up to which lines are drawn between them."""
MOST_PIXELS = 90_000
"""Largest number of pixels in view; beyond, single ones would not be seen."""
ON_PICTURE = "#f0b429"
"""Outline on a picture that has both black and white."""
FULL = 0.42
"""Opacity of a pixel that is covered whole, so that lines on it stay visible."""


class _ImageView(NamedTuple):
    """A microlens image; lengths relative to its microlens's axis [mm]."""

    openings: Openings
    """Images of the rims, the FAP's first."""
    outline: Array
    """Shape (N, 2), not closed; (0, 2) where dark."""
    cell: Array
    """Corners of its own cell, shape (M, 2)."""
    columns: slice
    rows: slice
    """Pixels in view."""
    x: Array
    """Edges of the pixels, shape (I + 1,)."""
    y: Array
    """Shape (J + 1,)."""
    coverage: Array
    """Share of each pixel that the image covers, shape (J, I); (0, 0) where there are more than was asked for
    or a disc is too large for it."""
    kept_fraction: float
    on_sensor: float
    """Share of the image that falls on the sensor; 1 where dark."""
    half: float
    """Half width of a view that shows the FAP's disc and the cell."""

    @property
    def sensor_in_view(self) -> bool:
        """Whether any of it is."""
        return len(self.x) > 1 and len(self.y) > 1


def _image_view(design: Design, place: Point, most: float = math.inf) -> _ImageView:
    """The image behind the microlens at a place on the MLA [mm]; `most` pixels in view are looked at one by one."""
    openings = field_openings(design, [place]).at(0)
    middle, spans = openings.centres[0], openings.spans
    (axis,) = MicrolensImages(Camera.of(design), [place]).in_system
    pitch, q = abs(float(microlens_image_pitch(Camera.of(design)))), design.q
    cell = cell_polygon(design.microlens_array.layout, pitch, design.microlens_array.rotation) + middle
    half = 1.12 * max(float(spans[0]) / 2, float(np.max(np.abs(cell - middle))))
    start = design.sensor.decentre - np.multiply(design.pixels, q) / 2
    ends = np.array([np.floor((middle + axis - half - start) / q), np.ceil((middle + axis + half - start) / q)])
    columns, rows = (slice(*side) for side in np.clip(ends, 0, design.pixels).astype(int).T.tolist())
    count = (columns.stop - columns.start) * (rows.stop - rows.start)
    drawable = count <= most and spans.max() <= 2 * LARGEST_RADIUS * q and spans.min() <= LARGEST_PART * q
    x, y = (
        start[k] + q * (np.arange(s.start, s.stop + 1) if drawable else np.unique([s.start, s.stop])) - axis[k]
        for k, s in enumerate((columns, rows))
    )
    shares = np.zeros((0, 0))
    if drawable and count:
        covered = openings.coverage(
            axis, pixel=q, size=design.pixels, sensor_centre=design.sensor.decentre,
            window=(rows, columns),
        )  # fmt: skip
        shares = np.asarray(covered, float)
    image, on_sensor = openings.common(), 1.0
    if image.lit:
        low, size = start - axis, np.multiply(design.pixels, q)
        sensor = low + size * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        inside = float(openings.area_in(sensor)) if size.min() > 0 else 0.0
        on_sensor = min(inside / float(image.area), 1.0)
    edge, kept = openings.outline(), float(image.kept_fraction)
    return _ImageView(openings, edge, cell, columns, rows, x, y, shares, kept, on_sensor, half)


def nearest_microlens(design: Design, place: Point, *, inward: bool = False) -> Point:
    """Axis of the microlens nearest to a place or, with `inward`, not farther out; both on the MLA [mm]."""
    array = design.microlens_array
    if inward:
        x, y = (math.copysign(max(abs(side) - 0.499 * array.pitch, 0.0), side) for side in place)
        place = x, y
    lattice = Lattice(array.pitch, array.size, array.layout)
    x, y = lens_centres(lattice, nearest_lens(lattice, place))
    return float(x), float(y)


def microlens_image(
    design: Design, place: Point, size: Point = (320, 380), *, waves: bool = False, pixels: bool = True,
    name: str = "microlens", label: str = "", key: bool = True, snap: bool = True,
) -> Picture:  # fmt: skip
    """Draw the image behind one microlens.

    Parameters
    ----------
    design : Design
        A real lens is taken as its thin-lens model; tilts of FAP, main lens, array and sensor are left out.
    place : (x, y)
        On the MLA [mm]; the nearest microlens is shown.
    size : (width, height)
        [px].
    waves, pixels : bool
        Whether pixels are shown as they are recorded under uniform light, diffraction and neighbours' light included,
        or by the share of each that this microlens's geometric image covers; whether they are drawn at all.
    name, label : str
        Unique on the page, where several microlenses are shown; what the place is called, such as "edge".
    key, snap : bool
        Whether a legend is drawn; False shows a microlens at exactly that place.

    Returns
    -------
    Picture
        Its mapping takes pixels to places relative to the microlens's axis [um].
    """
    place = nearest_microlens(design, place) if snap else place
    view = _image_view(design.thin_twin, place, MOST_PIXELS)
    keys = _image_keys(design, waves and pixels) if key else []
    foot = legend_height(keys, size[0] - 24)
    width, height = size[0] - LEFT - RIGHT, size[1] - TOP - BELOW - foot
    side = max(min(width, height), 60.0)
    box = (LEFT + max(0.0, (width - side) / 2), TOP, side, side)
    x, y = (Scale(UM * (middle - view.half), UM * (middle + view.half)) for middle in view.openings.centres[0].tolist())
    marks, words = _light(design, view, waves) if pixels else ([], "")
    if pixels and view.coverage.size > 0 and view.coverage.shape[1] <= GRID_UP_TO:
        # Lines between pixels, unless they would be all there is to see.
        a, b = UM * view.x, UM * view.y
        across = parted([[c, c] for c in a] + [[a[0], a[-1]]] * len(b))
        marks.append(Line(across, parted([[b[0], b[-1]]] * len(a) + [[c, c] for c in b]), "grey", 0.5, opacity=0.35))
    where = f"{short(place[0])}, {short(place[1])} mm"
    state = "dark" if view.kept_fraction == 0 else f"{100 * view.kept_fraction:.4g} % unvignetted"
    if view.on_sensor <= 0.995 and view.kept_fraction > 0:
        state += f", {100 * view.on_sensor:.3g} % on the sensor"
    colour = "ink" if view.kept_fraction == 1 else "vermillion"
    head = f"{label}: {where}" if label else f"at {where}"
    words = f"{state}, {words}" if words else state
    aside = drawn_in(words, box[0], size[0], SMALL)
    marks = [
        *_beyond(view, x, y), *marks, *_lines(design, view, waves and pixels),
        Text(x.low, y.high, head, "ink", PLAIN, dx=drawn_in(head, box[0], size[0], bold=True), dy=-26, bold=True),
        Text(x.low, y.high, words, colour, SMALL, dx=aside, dy=-9, testid="microlens-kept"),
    ]  # fmt: skip
    panel = Panel(box, x, y, tuple(marks), "x from the axis [µm]", "y from the axis [µm]", grid="", equal=True)
    kept = "no light" if view.kept_fraction == 0 else f"{100 * view.kept_fraction:.4g} % of the pupil unvignetted"
    title = f"Image of the microlens at {where} on the MLA: {kept}"
    return Picture(name, title, size, (panel,), tuple(keys), (14.0, panel.bottom + BELOW - 2, size[0] - 24))


def microlens_images(designs: Mapping[str, tuple[Design, Point]]) -> tuple[Picture, float]:
    """Draw up to three images in a row with one legend: of designs and microlenses on the MLA [mm], each with its name.

    Returns the picture, and the least share of an image that falls on the sensor.
    """
    size = PAGE / 3, PAGE / 3 - LEFT - RIGHT + TOP + BELOW
    pictures = [
        microlens_image(design, place, size, name=f"images-{label}", label=label, key=False, snap=False)
        for label, (design, place) in designs.items()
    ]
    keys = {key.text: key for design, _ in designs.values() for key in _image_keys(design)}
    least = min(_image_view(design.thin_twin, place, 0).on_sensor for design, place in designs.values())
    title = f"Microlens images: {'; '.join(p.title for p in pictures)}"
    return beside("images", title, pictures, list(keys.values())), least


def _light(design: Design, view: _ImageView, waves: bool) -> tuple[list[Mark], str]:
    """Pixels as an image, and what to say of them."""
    plain: list[Mark] = [Area(*xy(UM * view.outline), "ink", FULL)] if len(view.outline) else []
    if not view.coverage.size:
        return (plain, "pixels too small to draw") if view.sensor_in_view else ([], "")
    box = (UM * view.x[0], UM * view.x[-1], UM * view.y[0], UM * view.y[-1])
    if not waves:
        return [Image(view.coverage, box, "ink", 0.0, 1 / FULL)], ""
    patch = white_patch(design, view.columns, view.rows)
    if patch is None:
        return plain, "too many images overlap for diffraction"
    peak = float(patch.max(initial=0.0))
    return [Image(patch, box, "blues", 0.0, max(peak, 1.0))], f"peak {short(peak, 2)}"


def _lines(design: Design, view: _ImageView, on_picture: bool) -> list[Mark]:
    marks: list[Mark] = []
    for k, (_, colour) in enumerate(_rims(design, on_picture)):
        marks.append(_rim_mark(view.openings.some([k]), colour, 1.2, "5 3"))
    if len(view.outline):
        x, y = UM * np.append(view.outline, view.outline[:1], axis=0).T
        if on_picture:
            marks.append(Line(x, y, "#000000", 3.2, opacity=0.5))
        marks.append(Line(x, y, ON_PICTURE if on_picture else "ink", 1.8, testid="microlens-outline"))
    marks.append(Area(*xy(UM * view.cell), "none", 1.0, "green", 1.8))
    marks.append(Dots(*xy(UM * view.openings.centres[:1]), "vermillion", "+", 6, width=2, clip=True))
    return marks


def _rim_mark(rim: Openings, colour: str, width: float, dash: str) -> Mark:
    """One rim's own image."""
    if rim.polygons or rim.ellipses:
        return Area(*xy(UM * rim.outline()), "none", 1.0, colour, width, dash)
    ((x, y),), (radius,) = rim.centres, rim.radii
    return Disc(UM * x, UM * y, UM * radius, edge=colour, width=width, dash=dash)


def _rims(design: Design, on_picture: bool = False) -> list[tuple[str, str]]:
    """Names and colours of what cuts an image: FAP, main lens, further stops, elements."""
    camera = Camera.of(design)
    colours = [ON_PICTURE if on_picture else "ink", "blue", *map(stop_colour, range(1, len(camera.chain.stops) + 1))]
    colours += ["grey"] * (len(camera.openings) - len(colours))
    return [(rim.opening, colour) for rim, colour in zip(camera.openings, colours, strict=True)]


def _beyond(view: _ImageView, x: Scale, y: Scale) -> list[Mark]:
    """Hatching where the sensor ends."""
    frame = np.array([*x[:2], *y[:2]])
    inside = np.full(4, np.nan)
    if view.sensor_in_view:
        sensor = UM * np.array([*view.x[[0, -1]], *view.y[[0, -1]]])
        inside = np.where([True, False, True, False], np.maximum(frame, sensor), np.minimum(frame, sensor))
        if np.allclose(inside, frame, rtol=0, atol=1e-9 * float(np.ptp(x[:2]))):
            return []
    # The hole runs the other way round: what both enclose stays free by any rule.
    (left, right, low, high), (a, b, c, d) = frame, inside
    xs = [left, right, right, left, np.nan, a, a, b, b]
    ys = [low, low, high, high, np.nan, c, d, d, c]
    return [Area(xs, ys, "grey", hatch=True)]


def _image_keys(design: Design, on_picture: bool = False) -> list[Key]:
    """Keys of the lines of a microlens image, on plain ground or on a picture of its light."""
    rims: dict[str, list[str]] = {}
    for name, colour in dict.fromkeys(_rims(design, on_picture)):
        rims.setdefault(colour, []).append(name)
    # Lines of one colour are not told apart.
    words = {colour: names[0] if len(names) == 1 else f"{len(names)} elements" for colour, names in rims.items()}
    openings = [line_key(f"rim of {of}", colour, 1.2, "5 3") for colour, of in words.items()]
    chief = dot_key("chief ray", "vermillion", "+", 6, width=2)
    return [
        line_key("image", ON_PICTURE if on_picture else "ink", 1.8),
        *openings,
        box_key("own cell", "none", 1.0, "green", 1.8),
        chief,
        *([Key("black: no light; white: 1, or the peak", ())] if on_picture else []),
    ]


def rays_and_waves(design: Design, width: float = PAGE, samples: int = 181) -> Picture:
    """Draw the microlens image on the axis with its neighbours, by ray and by wave optics, before pixels integrate.

    Unclipped, at `samples` points along each side.
    """
    camera = Camera.of(design)
    pitch = abs(float(microlens_image_pitch(camera)))
    image_of_fap = camera.fap.outline.sized(float(microlens_image_diameter(camera)))
    rim = Openings.of(image_of_fap, ())
    effects = plan(design, overrides=["+microlens_diffraction", "+overlap", "-vignetting", "-tilts", "-decentres"])
    flat = planned_camera(design, effects)
    half, lattice = 0.75 * pitch, ImageLattice.of(flat)
    axis = np.linspace(-half, half, samples)
    wave = harmonic_series(flat, MicrolensTransfer.of(flat, effects), pixel=False).at(axis, axis)
    ray = _images_over(lattice, image_of_fap, np.stack(np.meshgrid(axis, axis), -1), half)
    light, top = encircled(camera), max(1.0, float(wave.max()))
    each, reach = width / 2, UM * half
    side = each - 56 - 68
    cell = UM * cell_polygon(camera.layout, pitch, float(flat["microlens_array.rotation"]))
    pictures = []
    waves = f"Waves: {percent(light.disc, 1)} in the {image_of_fap.kind}, {percent(light.cell, 1)} in the cell"
    for number, (image, title) in enumerate((
        (ray, f"Rays: all light in the {image_of_fap.kind}"),
        (np.asarray(wave, float), waves),
    )):  # fmt: skip
        marks: list[Mark] = [
            Image(image, (-reach, reach, -reach, reach), "cividis", 0.0, top),
            _rim_mark(rim, "#000000", 3.0, ""), _rim_mark(rim, "#ffffff", 1.0, ""),
            Area(*xy(cell), "none", 1.0, "#000000", 3.0), Area(*xy(cell), "none", 1.0, "#ffffff", 1.4, "5 3"),
        ]  # fmt: skip
        scale = Scale(-reach, reach)
        panel = Panel(
            (56, 28, side, side), scale, scale, tuple(marks), "x on the sensor [µm]", "y on the sensor [µm]", title,
            grid="", equal=True,
        )  # fmt: skip
        bar = colour_bar(panel, 0.0, top, "cividis", "relative intensity")
        pictures.append(Picture(f"waves-{number}", title, (each, side + 28 + 42), (panel, bar)))
    dark = Line((-11.0, 11.0), (0.0, 0.0), "#000000", 4.0)
    keys = [
        Key("geometric image", (dark, Line((-11.0, 11.0), (0.0, 0.0), "#ffffff", 1.4))),
        Key("cell of one image pitch", (dark, Line((-11.0, 11.0), (0.0, 0.0), "#ffffff", 1.4, "5 3"))),
    ]
    return beside("waves", "One microlens image by rays and by waves", pictures, keys)


def _images_over(lattice: ImageLattice, image: ClearAperture, points: Array, half: float) -> Array:
    """How many images cover points (N, N, 2) within `half` of the sensor's middle: of discs row by row of images."""
    index, (step, _) = lattice.indices(-half, half, -half, half), lattice.image_axes.T
    if image.straight:
        return np.asarray(
            sum(image.contains(*np.moveaxis(points - at, -1, 0)).astype(float) for at in lattice.image(index))
        )
    radius = float(image.radius)
    length, total = np.linalg.norm(step), np.zeros(points.shape[:2])
    along = step / length
    for row in np.unique(index[:, 1]):
        first, last = (end(index[index[:, 1] == row, 0]) for end in (np.min, np.max))
        apart = points - lattice.image(np.array([0, row]))
        aside = apart @ [-along[1], along[0]]
        reach = np.sqrt(np.maximum(radius**2 - aside**2, 0.0)) / length
        middle = apart @ along / length
        count = np.minimum(np.floor(middle + reach), last) - np.maximum(np.ceil(middle - reach), first) + 1
        total += np.where(np.abs(aside) <= radius, np.maximum(count, 0.0), 0.0)
    return total


def preview(image: RawImage) -> Picture:
    """Draw a raw image with zooms of about five microlens images at its centre, edge and corner.

    Of a part of the sensor the titles say so.
    """
    pixels, region = image.pixels, image.region
    top = max(float(np.percentile(pixels[:: max(1, region.rows // 500)], 99.9)), 1e-9)
    # Every so many pixels would beat with the microlenses: show means of blocks.
    step = max(1, -(-max(pixels.shape) // 1400))
    kept = pixels[: pixels.shape[0] // step * step, : pixels.shape[1] // step * step]
    small = np.asarray(kept.reshape(kept.shape[0] // step, step, -1, step).mean((1, 3)), float)
    about_five = round(5 * abs(float(microlens_image_pitch(Camera.of(image.design)))) / image.design.q)
    side = min(max(24, about_five), region.rows, region.columns)
    right, upper = region.columns - side, region.rows - side

    def panel(at: Point, size: Point, values: Array, title: str, start: Point, count: Point) -> Panel:
        x, y = (Scale(low, low + high) for low, high in zip(start, count, strict=True))
        shown = Image(values, (*x[:2], *y[:2]), "grey", 0.0, top)
        return Panel((*at, *size), x, y, (shown,), "column [px]", "row [px]", title, grid="", equal=True)

    width = 1056.0
    scale = min((width - 70 - 90) / region.columns, 420 / region.rows)
    wide, high = scale * region.columns, scale * region.rows
    title, at = f"{image.design.name}: {image.scene.name or 'scene'}", (70 + (width - 160 - wide) / 2, 30.0)
    whole = panel(at, (wide, high), small, title, (region.column, region.row), (region.columns, region.rows))
    below, each = high + 30 + 78, 220.0
    panels, frames = [], []  # type: list[Panel], list[Mark]
    part_of = "" if (region.columns, region.rows) == image.design.pixels else " of this region"
    for name, left, colour, column, row in (
        ("centre", 70.0, "blue", right // 2, upper // 2), ("edge", 410.0, "vermillion", right, upper // 2),
        ("corner", 750.0, "green", right, upper),
    ):  # fmt: skip
        part = np.asarray(pixels[row : row + side, column : column + side], float)
        start = region.column + column, region.row + row
        zoomed = panel((left, below), (each, each), part, name + part_of, start, (side, side))
        (a, b, _), (c, d, _) = zoomed.x, zoomed.y
        frame = Area([a, b, b, a], [c, c, d, d], "none", 1.0, colour, 3.0, clip=False)
        panels.append(zoomed.with_marks(frame))
        frames.append(frame)
    bar = colour_bar(whole, 0.0, top, "grey", "relative intensity")
    return Picture(
        "preview", f"Raw image of {image.design.name}", (width, below + each + 44),
        (whole.with_marks(*frames), bar, *panels),
    )  # fmt: skip
