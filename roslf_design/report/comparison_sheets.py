"""The figures of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .blocks import Figure
from .figures.depth_comparison import plot_depth_comparison
from .figures.microlens_images import plot_microlens_image
from .figures.style import drawing
from .sheets import compose, draw_ray_diagrams, new_drawing, shared_legend

if TYPE_CHECKING:
    from ..design import Design


def ray_sheet(letter: str, design: Design) -> Figure:
    """The meridional section of one of the designs."""
    with drawing():
        figure = draw_ray_diagrams(design)
        caption = "To scale, each design in a scale of its own. Dashed orange rays end at what blocks them."
        return compose(f"rays-{letter}", f"{letter}: {design.name}", caption, figure)


def image_sheet(letters: str, designs: Sequence[Design], places: Sequence[tuple[float, float]]) -> Figure:
    """The microlens image of each design at its sensor's corner."""
    with drawing():
        figure = new_drawing(3.4)
        axes = list(figure.subplots(1, 3))
        for ax, letter, design, place in zip(axes, letters, designs, places, strict=False):
            plot_microlens_image(design, place, ax)
            ax.set_title(f"{letter}: {ax.get_title(loc='left')}")
        for ax in axes[len(designs) :]:
            ax.remove()
        shared_legend(figure, axes[: len(designs)], "outside lower center")
        caption = (
            "Ray-optics images on their pixels. A full disc sees the whole pupil; a cat's eye has lost what the dashed "
            "discs cut away. Images as wide as the green cell use every pixel once."
        )
        return compose("images", "Microlens images at the sensor's corner", caption, figure)


def depth_sheet(letters: str, designs: Sequence[Design]) -> Figure:
    """Depth precision of all designs."""
    with drawing():
        figure = new_drawing(3.2)
        plot_depth_comparison(dict(zip(letters, designs, strict=False)), figure.subplots())
        caption = (
            "One standard deviation of depth for 0.1 microlens pitches of disparity error between the FAP's rims, over "
            "the distance from the bore's end; dots mark the focal planes. The lower curve resolves depth better there."
        )
        return compose("depth", "Depth precision", caption, figure)
