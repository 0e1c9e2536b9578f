"""Sentences of reports about a main lens, ideal or real."""

from __future__ import annotations

from ..bore.main_lens import IdealMainLens, MainLensKind, RealMainLens, SheetMainLens


class _LensWords:
    """Words about an ideal main lens."""

    assumed: str = (
        "The main lens is ideal and thin: no aberrations, distortion, field curvature or colour. "
        "Real lenses add theirs."
    )
    """Its model."""
    remark = ""
    """Remark beside its focal length."""
    twin = ""
    """Sentence on pictures of rays through its thin-lens model."""
    bought = ""
    """Words for where it comes from, where that is known."""
    part = "focal length {focal_length}, {aperture}, ideal in this report"
    """Line of the parts list."""
    unlit = "dark"
    """Words for an image that no light reaches."""
    sheet: tuple[str, ...] = ()
    """Paragraphs of the data sheet."""
    curves = ""
    """Sentence below MTF curves."""
    unmeasured: tuple[str, ...] = ("real lens",)
    """Quantities of the accuracy table that it does not have."""
    uncounted: tuple[str, ...] = ()
    """Sentences on what the study of accuracy leaves out of it."""

    def __init__(self, lens: MainLensKind) -> None:
        self.title = lens.name or lens.words
        if lens.untold:
            self.assumed, self.sheet, self.bought = lens.untold, (lens.untold,), f"{lens.name}, by its data sheet"


class _RealLensWords(_LensWords):
    """Words about a real main lens."""

    assumed = (
        "The main lens is real. Its exact rays stand under Real main lens, in the verdicts and in a data sheet's "
        "fields and resolution; all else, tables, ray diagrams, maps and design space, is its thin-lens model: an "
        "ideal lens of the same focal length and clear diameter, with distances counted from the principal planes."
    )
    part = "{name}, {aperture}"
    unlit = "dark or folded"
    sheet = (
        "The main lens is real: angles and widths of view, resolution, distortion and light over the field are what "
        "rays through it show. Distances of sharpness, magnification on the axis and spreads of what builds have as a "
        "whole are those of its thin-lens model.",
    )
    curves = (
        " Rays through the real lens show what it does to the light of a point: a view has of its aberrations what its "
        "part of the FAP sees, the refocused image all that its sharpest slope does not undo."
    )
    unmeasured = ()
    uncounted = ('The lens counts as thin and ideal in all quantities but "real lens".',)

    def __init__(self, lens: MainLensKind) -> None:
        super().__init__(lens)
        self.remark, self.bought = f"{lens.name}, at this wavelength", f"{lens.name}, as prescribed"
        self.twin = (
            f" Lens and rays are those of the thin-lens model; through {lens.name} they are traced further below."
        )


_WORDS = {IdealMainLens: _LensWords, SheetMainLens: _LensWords, RealMainLens: _RealLensWords}


def lens_words(lens: MainLensKind) -> _LensWords:
    """Words about a main lens."""
    return _WORDS[type(lens)](lens)
