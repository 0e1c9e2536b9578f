"""`--accuracy` of `roslf evaluate`: more rays where they are counted, and shares within what was asked for."""

import numpy as np
import pytest

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.cli import main
from roslf_design.evaluation.fields import evaluate_fields, rays_for
from roslf_design.theory.stop_images import MicrolensImages

PAPER = roslf.load("paper")


@pytest.mark.parametrize("accuracy", [1e-1, 1e-2, 1e-3])
def test_counted_shares_are_within_the_accuracy_of_exact_ones(accuracy):
    rng = np.random.default_rng(8)
    for _ in range(6):
        tilt = (float(rng.normal(0, 0.03)), float(rng.normal(0, 0.03)))
        design = PAPER.replace({"main_lens.diameter": float(rng.uniform(14, 30)), "aperture.tilt": tilt})
        axis = (float(rng.uniform(2, 7)), float(rng.uniform(-3, 3)))
        exact = MicrolensImages(Camera.of(design), [axis]).shapes
        (field,) = evaluate_fields(design, [axis], rays_for(accuracy))
        # Rays fill the FAP evenly, areas are those on the sensor: they differ by the perspective of the tilt, 1e-3.
        assert abs(field.kept_fraction - exact.kept_fraction.item()) <= accuracy + 2e-3


def test_more_digits_take_more_rays():
    assert rays_for(1e-2) < rays_for(1e-3) < rays_for(1e-4)
    with pytest.raises(ValueError, match="straight designs are exact"):
        rays_for(1e-9)


def test_straight_designs_are_exact_whatever_is_asked():
    assert roslf.evaluate(PAPER, accuracy=1e-12).to_dict() == roslf.evaluate(PAPER).to_dict()


def test_result_tells_how_many_rays_and_how_far_off(tmp_path, capsys):
    tilted = PAPER.replace({"aperture.tilt": (0.02, 0.0)})
    path = tmp_path / "tilted.toml"
    roslf.save(tilted, path)
    result = roslf.evaluate(tilted, accuracy=5e-3)
    assert f"{rays_for(5e-3)} rays" in result.method
    assert "0.005" in result.method
    assert {field.rays for field in result.fields} == {rays_for(5e-3)}
    assert main(["evaluate", str(path), "--accuracy", "1e-9"]) == 2
    assert "--accuracy" in capsys.readouterr().err


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-20", "fine", "2"])
def test_no_accuracy_is_one_line(value, capsys):
    assert main(["evaluate", "paper", "--accuracy", value]) == 2
    told = capsys.readouterr()
    assert "--accuracy" in told.err
    assert len(told.err.strip().splitlines()) == 1
    assert told.out == ""


def test_every_evaluation_carries_what_it_is_worth(tmp_path, capsys):
    import json

    assert main(["evaluate", "paper", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["accuracy"]
    assert told["expected_error"] <= 1e-12
    assert "seconds" not in told  # the same bytes every time
    path = tmp_path / "tilted.toml"
    roslf.save(PAPER.replace({"aperture.tilt": (0.02, 0.0), "main_lens.diameter": 9.0}), path)
    assert main(["evaluate", str(path), "--accuracy", "5e-3", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["accuracy"]
    assert told["kept"]
    assert 0 <= told["measured_error"] <= 5e-3
    assert told["seconds"] > 0
    assert main(["evaluate", "paper", "--accuracy", "5e-3"]) == 0
    assert "expected within 1e-12" in capsys.readouterr().out


def test_a_report_passes_it_on(tmp_path):
    from roslf_design.commands.report import maker
    from roslf_design.reporting.design import accuracy_section

    tilted = PAPER.replace({"aperture.tilt": (0.02, 0.0)})
    path = tmp_path / "tilted.toml"
    roslf.save(tilted, path)
    for names, compare in (((str(path),), False), ((str(path), "paper"), True)):
        assert maker(names, compare, None, 0.01).keywords["accuracy"] == 0.01
    section = accuracy_section(tilted, roslf.evaluate(tilted, accuracy=0.01), 0.01)
    assert f"{rays_for(0.01)} rays" in str(section)
    assert "asked for 0.01" in str(section)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-20", "fine"])
def test_a_report_to_no_accuracy_is_refused(value, tmp_path, capsys):
    for line in (["report", "paper"], ["report", "--compare", "paper", "paper-mismatched"]):
        assert main([*line, "-o", str(tmp_path / "out"), "--accuracy", value]) == 2
        told = capsys.readouterr().err
        assert "--accuracy" in told
        assert len(told.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
