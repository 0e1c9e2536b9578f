"""Stories that ship: their files fit together, and their numbers are those that their sources say."""

import math

import pytest

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
    # inside a tube of 4 mm: parts and the sensor's diagonal
    assert max(prism.diameter, window.diameter, design.D, math.hypot(*design.sensor.size)) < 4 - 2 * 0.2
