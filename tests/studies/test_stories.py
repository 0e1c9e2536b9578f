"""Stories that ship: their files fit together, and their numbers are those that their sources say."""

import math

import pytest

from roslf_design import evaluate
from roslf_design.evaluation.required import required_of
from roslf_design.optimization.study import read_study as read_optimisation
from roslf_design.reporting.story import load_story_or_study
from roslf_design.tolerancing.study import read_study as read_tolerances

STORIES = ("arthroscope", "borescope", "otoscope")


@pytest.mark.parametrize("name", STORIES)
def test_every_part_of_a_story_reads_on_its_design(root, name):
    story = load_story_or_study(root / "studies" / f"story-{name}" / "story.toml")[1]
    assert [part.kind for part in story.table.parts] == ["optimize", "tolerance", "calibration"]
    for index, read in ((0, read_optimisation), (1, read_tolerances)):
        assert read(story.studies[index], story.folder, design=story.design)


def test_the_arthroscope_has_prism_window_and_saline(root):
    design = load_story_or_study(root / "studies" / "story-arthroscope" / "story.toml")[1].design
    prism, window = design.elements
    assert math.degrees(prism.deviation) == pytest.approx(30)
    assert (window.kind, window.material.name, design.object_space.medium.name) == ("plate", "sapphire", "saline")
    assert evaluate(design).answer.insertion_diameter_mm == design.tube.outer_diameter == 4
    # the window, turned with the view about the prism's middle, by hand: its farthest point from the tube's axis
    beyond = window.distance + window.thickness - prism.distance - prism.thickness / 2
    aside = beyond * math.sin(prism.deviation) + window.diameter / 2 * math.cos(prism.deviation)
    assert aside < 2 - 0.05


@pytest.mark.parametrize("name", ["arthroscope", "borescope", "otoscope"])
def test_a_story_requires_what_its_question_asks_for(root, name):
    """Size, field and depth; the design it starts from misses none of it, its lengths as drawn."""
    design = load_story_or_study(root / "studies" / f"story-{name}" / "story.toml")[1].design
    told = required_of(design)
    assert {"insertion_diameter_mm", "u_z_mm"} < {one.quantity for one in told}
    assert any("field" in one.quantity for one in told)
    assert all(one.met for one in told)
