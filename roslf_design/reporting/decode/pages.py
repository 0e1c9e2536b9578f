"""A decoded light field: sentences, tables and the page that the terminal shares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..._version import __version__
from ...calibration.centres import Reason
from ...calibration.white_profile import WhiteProfile
from ...depth.decoded import Decoded
from ...drawing.picture import Picture
from ...words import fixed, number, rounded, sentence
from ..blocks import Block, Code, Figure, Report, Section, Statement, Statements, Table
from . import pictures

UNLIKE = 0.02
"""Rms misfit of a white image's microlens images from which it is worth a look [fully lit pixels]."""
CAPTIONS = {
    "lattice": (
        "Microlens centres on the raw image",
        "Crosses are the fitted centres that views are read about; each should sit in the middle of its image. Colours"
        " tell which microlenses were used in the fit.",
    ),
    "white": (
        "Microlens images of the white image",
        "Dots: light of all whole microlens images, each pixel at its place behind its microlens, overlaid."
        " Line: an evenly lit pupil's, blurred by microlens and pixel, with the neighbours' light, on the veil.",
    ),
    "centre-view": (
        "The view through the middle of the pupil",
        "The light through the middle of the pupil, as it lies in the image, nothing turned; white where nothing was"
        " measured.",
    ),
    "views": (
        "All views",
        "Every view at its place in the pupil: s to the right, t downwards. Views that stay white get no light; parts"
        " that do are cut by a stop.",
    ),
    "refocus": (
        "Refocused by shift and sum",
        "All views, each shifted as points of that disparity move from view to view, and averaged: such points are"
        " sharp, others spread. The disparity is that between opposite edges of the views, above 0 for near points.",
    ),
    "epi": (
        "An epipolar-plane image",
        "One row of the scene through all views along s. Points of the focal plane stand upright; what is nearer moves"
        " to the left from view to view, what is farther to the right, and cut microlens images end early.",
    ),
}
"""Title and caption of each picture."""


def decoding_pictures(result: Decoded) -> dict[str, Picture]:
    """Every picture of a decoded light field."""
    drawn = {} if result.raw is None else {
        "lattice": pictures.lattice_overlay(result.raw.frame, result.raw.centres)
    }  # fmt: skip
    if result.white is not None:
        drawn["white"] = pictures.white_profile(result.white)
    return drawn | {
        "centre-view": pictures.centre_view(result.field, result.row, result.units),
        "views": pictures.views_sheet(result.field, result.units),
        "refocus": pictures.refocus_sheet(result.field, result.stack, result.units),
        "epi": pictures.epi_image(result.field, result.row, result.units),
    }


def _statements(result: Decoded) -> Iterator[Statement]:
    """Statements about a decoded light field, warnings among them."""
    field, sample_unit = result.field, result.units[1]
    if result.raw is not None:
        centres, lattice = result.raw.centres, result.raw.centres.lattice
        used = int(centres.used.sum())
        counts = [f"{count} {text}" for text, count in centres.counts().items() if text != Reason.USED.text]
        left = f" (left out: {', '.join(counts)})" if counts else ""
        said = (
            f"A {lattice.layout} lattice, {number(lattice.pitch)} px apart, turned by"
            f" {number(1e3 * lattice.rotation, 3, zero=1e-3)} mrad; {used} of {len(centres.indices)} microlenses say"
            f" where it lies{left}, each to {centres.rms:.2g} px rms."
        )
        yield Statement("good" if result.raw.white else "caution", said)
    if result.white is not None:
        yield from _white(result.white)
    wide, tall = len(field.s), len(field.t)
    samples = "microlenses" if result.raw is not None else "pixels"
    step = " on a square grid of 0.866 pitches" if field.hexagonal is not None else ""
    yield Statement(
        "plain",
        f"{result.views_with_light} of {wide} x {tall} views have light, each of {len(field.u)} x {len(field.v)}"
        f" {samples}{step}.",
    )
    if result.turned_over:
        ways = {"u": "left for right", "v": "up for down"}[result.turned_over]
        yield Statement("plain", f"Turned over, {ways}: the design's mirrors show the scene reversed.")
    if result.stack:
        ends = result.stack[0], result.stack[-1]
        span = " to ".join(f"{plane.disparity:+.3g}" for plane in ends)
        text = f"Refocused at {len(result.stack)} disparities, {span} {sample_unit} across the views"
        known = [f"{plane.distance:.4g}" for plane in ends if plane.distance is not None]
        text += f": {' to '.join(known)} mm by {result.distances_from}." if known else "."
        yield Statement("plain", text)
    for warning in result.warnings:
        yield Statement("caution", sentence(warning))


def _white(profile: WhiteProfile) -> Iterator[Statement]:
    """Statements about veil, width and profile of the microlens images of a white image."""
    unsure, lit = profile.sigma, "of a fully lit pixel"

    def told(value: float, sigma: float) -> str:
        return f"{rounded(value, sigma)} ± {sigma:.2g}"

    if profile.untold:
        yield Statement("caution", f"Veil and width of the microlens images are not reported here: {profile.untold}.")
    else:
        wide, pitch = profile.width, profile.lattice.pitch
        pupil = "a `design` would say how wide a pupil that is"
        if profile.pupil is not None and profile.narrower is not None:
            more = profile.narrower - 1
            off = f"{100 * abs(more):.2g} % {'narrower' if more < 0 else 'wider'} than the design's"
            off = off if abs(more) > 2 * unsure[0] else "as the design has it"
            pupil = f"the pupil is {told(profile.pupil, profile.pupil * unsure[0])} mm across, {off}"
        said = f"Microlens images are {told(wide, wide * unsure[0])} px wide, {wide / pitch:.3f} pitches: {pupil}."
        yield Statement("plain", said)
        veil = f"{told(100 * profile.veil, 100 * unsure[1])} % {lit}"
        if profile.full is not None:
            share = 100 / profile.full
            veil = f"{told(share * profile.veil, share * unsure[1])} % of full scale, {veil}"
        black = "" if profile.dark else "; without a dark frame the sensor's black level is in it"
        yield Statement("plain", f"On all of them lies a veil of {veil}{black}.")
    apart, alike, noise, dip, fitted = (
        100 * part for part in (profile.misfit, profile.symmetric, profile.noise, *profile.dips)
    )
    close = f"as far as noise shows, {noise:.2g} % rms {lit}"
    if apart > noise / 2:
        close = f"to {apart:.2g} % rms {lit} ({alike:.2f} % is alike on all sides; noise is {noise:.2g} %)"
    yield Statement(
        "good" if profile.misfit < UNLIKE else "caution",
        f"They follow an evenly lit pupil's {close}: between them light falls to {dip:.3g} %, by the fit to"
        f" {fitted:.3g} %. {profile.microlenses} microlenses say so.",
    )


def _focus_table(result: Decoded) -> Table:
    """Distances and disparities of the stack, with its files."""
    view_unit, sample_unit = result.units
    known = any(plane.distance is not None for plane in result.stack)
    rows = tuple(
        (
            *((("" if plane.distance is None else f"{plane.distance:.5g}"),) if known else ()),
            fixed(plane.disparity, 3, "+"),
            fixed(plane.slope, 5, "+"),
            name,
        )
        for plane, name in zip(result.stack, stack_names(result), strict=True)
    )
    heads = (
        *(("distance [mm]",) if known else ()), f"disparity [{sample_unit}]",
        f"slope [{sample_unit} per {view_unit.removesuffix('s')}]", "file",
    )  # fmt: skip
    return Table(rows, "d" * (len(heads) - 1) + "l", heads, "Refocused pictures")


def stack_names(result: Decoded) -> list[str]:
    """File of each refocused picture, far ones first."""
    return [f"refocus/plane_{number:02d}.png" for number in range(1, len(result.stack) + 1)]


def decoding_report(result: Decoded, drawings: Mapping[str, str], command: str) -> Report:
    """The page: what was decoded, pictures (SVG text by name), how to run it again."""
    figures = tuple(Figure(name, *CAPTIONS[name], text, ". ".join(CAPTIONS[name])) for name, text in drawings.items())
    answers: tuple[Block, ...] = (Statements(tuple(_statements(result))), _focus_table(result))
    sections = (
        Section("What was decoded", answers, "answers"),
        Section("Pictures", figures, "pictures"),
        Section("How it was done", (Code(command, "Run again"),), "how"),
    )
    return Report(f"Light field of {result.source}", "", sections, f"roslf_design {__version__}")
