"""Names, symbols and numbers as people read them, on pages, in figures and on a terminal.

Study files and JSON keep their names; text keeps symbols as ``d_3`` or ``D_F``, which each printer sets in its way.
"""

from __future__ import annotations

import math
import re
from html import escape

WORDS = {
    "fill_factor": "fill factor",
    "mismatch_px": "f-number mismatch",
    "non_distortion_room_mm": "undistorted-field margin",
    "undistorted_field_mm": "undistorted field radius",
    "field_half_width_mm": "field half width",
    "field_half_diagonal_mm": "field half diagonal",
    "field_half_angle_deg": "half angle of view",
    "field_half_height_mm": "field half height",
    "field_of_view_width_deg": "field of view, horizontal",
    "field_of_view_height_deg": "field of view, vertical",
    "field_of_view_deg": "field of view, full",
    "tip_field_of_view_width_deg": "field of view from the tip, horizontal",
    "tip_field_of_view_height_deg": "field of view from the tip, vertical",
    "tip_field_of_view_deg": "field of view from the tip, full",
    "direction_of_view_deg": "direction of view",
    "object_magnification": "magnification, array to object",
    "mtf50_lp_per_mm": "resolution, MTF 50 %",
    "mtf10_lp_per_mm": "resolution, MTF 10 %",
    "fold_lp_per_mm": "folding frequency",
    "depth_of_field_near_mm": "depth of field, near",
    "depth_of_field_far_mm": "depth of field, far",
    "view_depth_of_field_near_mm": "depth of field of a view, near",
    "view_depth_of_field_far_mm": "depth of field of a view, far",
    "hyperfocal_mm": "hyperfocal distance",
    "view_hyperfocal_mm": "hyperfocal distance of a view",
    "distortion_percent": "distortion",
    "local_magnification": "local magnification",
    "relative_illumination": "relative illumination",
    "object_sample_mm": "object sample",
    "sigma_z_mm": "depth spread σ_Z",
    "sigma_z_at_field_mm": "depth spread σ_Z at the field",
    "sigma_disparity_pitches": "disparity error",
    "pixel_electrons": "electrons a pixel",
    "sensor_angle_deg": "steepest ray at the sensor",
    "blur_pitches": "defocus blur",
    "spot_pitches": "blur of the lens",
    "main_lens.bending": "bending of the lens",
    "lateral_samples": "microlenses across",
    "views_geometric": "pixels across a microlens image",
    "views_independent": "independent views",
    "fresnel_number": "Fresnel number",
    "airy_radius_px": "Airy radius",
    "view_baseline_mm": "view baseline",
    "light_sr": "light a pixel gets",
    "f_number_microlens": "microlens f-number d_2/d",
    "f_number_microlens_lens": "microlens f-number f_ml/d",
    "f_number_pupil": "pupil f-number",
    "f_number_main_lens": "main-lens f-number",
    "vergence_at_mla_per_mm": "exit-pupil vergence 1/L",
    "telecentric_offset_mm": "distance from telecentric, d_3 - f",
    "microlens_defocus_px": "microlens defocus",
    "magnification": "magnification",
    "working_distance_mm": "working distance",
    "working_distance": "working distance",
    "total_length_mm": "length from tip to sensor",
    "camera_length_mm": "length from lens to sensor",
    "largest_diameter_mm": "largest diameter",
    "outer_diameter_mm": "outer diameter",
    "image_diameter_mm": "microlens-image diameter",
    "image_diameter_px": "microlens-image diameter",
    "image_pitch_mm": "microlens-image pitch",
    "image_area_mm2": "microlens-image area",
    "centre_shift_px": "image-centre shift",
    "centre_shift_px_per_microlens": "image-centre shift per microlens",
    "kept_fraction": "kept fraction",
    "axis_ratio": "axis ratio",
    "centre_error_px": "image-centre error",
    "centre_error_x_px": "image-centre error along x",
    "centre_error_y_px": "image-centre error along y",
    "depth_error_mm": "depth error",
    "disparity_pitches_per_mm": "disparity per depth",
    "aperture_constant": "aperture constant H",
    "inverse_aperture_constant": "1/H",
}
"""Name of a quantity, of a metric, or of a variable that is no symbol of the paper, to words; the unit goes beside."""
_NAME = re.compile(rf"(?<![\w.])({'|'.join(sorted(WORDS, key=len, reverse=True))})(?:@(\d+))?(?![\w@])")

SYMBOL = re.compile(r"(?<![\w.])([A-Za-zσλΔ])_(ml|[0-9A-Zfkx])(?!\w)(/[dDqL](?!\w))?")
"""A letter with a subscript, such as d_3, D_F, X_ml, σ_Z; with what it is divided by, as in d_2/d."""
LETTERS = frozenset("DfdqHLλ")
"""Symbols of one letter; set as such where they are a whole text, such as a cell."""
SPELT_OUT = {"um": "µm", "lambda": "λ", "sigma": "σ"}
"""Signs of what is written in plain letters elsewhere."""
_WORD = re.compile(r"\b(um|lambda|sigma(?=_))(?![A-Za-z0-9])")
_TAGS = {"plain": "{}", "symbol": "<var>{}</var>", "sub": "<sub>{}</sub>"}


def in_words(text: str) -> str:
    """A sentence or a label with names put into words: ``sigma_z_mm at 40 mm``, ``fill_factor@2``."""
    return (
        _NAME.sub(lambda match: WORDS[match[1]] + (f" at field {match[2]}" if match[2] else ""), text)
        .replace(" >= ", " ≥ ")
        .replace(" <= ", " ≤ ")
    )


def typographic(text: str) -> str:
    """Text with µm and Greek letters as such."""
    return _WORD.sub(lambda match: SPELT_OUT[match[0]], text)


def spans(text: str) -> list[tuple[str, str]]:
    """Text in pieces of (kind, text): "plain", or a "symbol" and its "sub"; a text of one letter is a symbol."""
    text = typographic(text)
    if text in LETTERS:
        return [("symbol", text)]
    pieces, last = [], 0
    for match in SYMBOL.finditer(text):
        pieces += [("plain", text[last : match.start()]), ("symbol", match[1]), ("sub", match[2])]
        if match[3]:
            pieces += [("plain", "/"), ("symbol", match[3][1:])]
        last = match.end()
    return [piece for piece in [*pieces, ("plain", text[last:])] if piece[1]]


def to_html(text: str) -> str:
    """Text as HTML: escaped, symbols in italics with subscripts."""
    return "".join(_TAGS[kind].format(escape(piece)) for kind, piece in spans(text))


ROUNDING = 1e-12
"""Below this a number of millimetres, pixels or shares is what rounding left of 0."""


def number(value: float, digits: int = 5, zero: float = ROUNDING) -> str:
    """A number to `digits` significant digits, infinity as a sign; "0" where it is smaller than `zero`.

    Up to 100,000 without powers of ten: "1090", not "1.09e+03".
    """
    if math.isnan(value):
        return "not stated"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if abs(value) < zero or value == 0:
        return "0"
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+0" in text and abs(float(text)) < 1e5 else text


def tidy(value: float) -> str:
    """A number that is about right, to two digits, but all of those before the point: "0.13", "130"."""
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.2g}"


def fixed(value: float, decimals: int, sign: str = "") -> str:
    """A number to so many decimals, never as -0; `sign` "+" writes both signs."""
    return f"{round(float(value), decimals) + 0.0:{sign}.{decimals}f}"


def place(position: tuple[float, float], digits: int = 6) -> str:
    """A position [mm] as text: "11.15, 0"."""
    return ", ".join(number(value, digits) for value in position)


def rounded(value: float, sigma: float) -> str:
    """An estimate to two digits of its standard deviation."""
    return f"{value:.{max(0, min(8, 1 - math.floor(math.log10(sigma)))) if sigma > 0 else 6}f}"


def length(value: float) -> str:
    """A length [mm] as a reader wants it: five digits, micrometres below 0.1 mm."""
    text = number(value)
    return f"{text} mm" if abs(value) >= 0.1 or text == "0" else f"{1e3 * value:.5g} um"


def sentence(text: str) -> str:
    """Text with a capital and a full stop; "f-number" and symbols such as d_3 keep their small letter."""
    capital = text[:1].upper() + text[1:] if text[:2].isalpha() or text[:2] == "a " else text
    return capital if not text or text.endswith((".", "?")) else f"{capital}."


def spaced(name: str) -> str:
    """A name of a file or of JSON with spaces: ``mla_rotation``."""
    return re.sub(r"\b(fap|mla)\b", lambda match: match[0].upper(), name.replace("_", " "))


def listed(names: list[str]) -> str:
    """Names as a sentence lists them."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
