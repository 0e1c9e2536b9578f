"""Sensors' figures against what their sources state: sizes by formats, full well and read noise by decibels."""

import math
import re

import pytest
from scipy.optimize import brentq

import roslf_design as roslf
from roslf_design.camera import Camera
from roslf_design.catalogue import load_catalogue
from roslf_design.catalogue.conditions import read_condition
from roslf_design.cli import main
from roslf_design.optimization import Combinations
from roslf_design.optimization.bounds import prunable
from roslf_design.theory.quantities import QUANTITIES
from tests.catalogue.test_named_parts import SCOPE
from tests.optimization.posing import goal, posed

SENSORS = {part.part: part for part in load_catalogue().sensors}
NUMBER = r"([\d.]+)"


@pytest.mark.parametrize("part", SENSORS.values(), ids=SENSORS)
def test_entries_are_what_their_sources_state(part):
    """Pitch, pixels, sides [mm], diagonal; an optical format of one inch is a diagonal of 16 mm, of small ones 18."""
    told, (width, height) = part.provenance.partition(", package of")[0], part.size
    if part.confidence == "datasheet":
        assert f"{1e3 * part.pixel:.3g} um" in told.replace(".0 um", " um")
        assert f"{part.pixels[0]} x {part.pixels[1]}" in told + part.remark
    if size := re.search(f"{NUMBER} x {NUMBER} mm(?! iLCC)", told):
        assert (width, height) == pytest.approx(tuple(map(float, size.groups())), rel=2e-3)
    if across := re.search(f"{NUMBER} mm diagonal", told):
        assert math.hypot(width, height) == pytest.approx(float(across[1]), rel=6e-3)
    if form := re.search(f"(?:([12])/)?{NUMBER} inch", told):
        inches = float(form[1]) / float(form[2]) if form[1] else float(form[2])
        assert 15.2 <= math.hypot(width, height) / inches <= 18.5


def in_decibels(part):
    """SNRmax and dynamic range of an entry by EMVA 1288, rounded to 12 bits: the signal as large as its noise."""
    dark = part.read_noise**2 + (part.full_well / 2**12) ** 2 / 12
    least = brentq(lambda signal: signal - math.sqrt(signal + dark), 1e-3, 1e3)
    return 10 * math.log10(part.full_well), 20 * math.log10(part.full_well / least)


def test_full_well_and_read_noise_are_the_decibels_that_were_measured():
    """As camera makers measure; of data sheets without EMVA 1288 the dynamic range is full well over read noise."""
    stated = {
        name: tuple(map(float, found.groups()))
        for name, part in SENSORS.items()
        if (found := re.search(f"SNR(?:max)? {NUMBER} dB, (?:pixel )?dynamic range {NUMBER} dB", part.provenance))
    }
    sheets = {"MT9P031": stated.pop("MT9P031")}
    assert len(stated) == 6
    for name, decibels in stated.items():
        assert "EMVA 1288" in SENSORS[name].provenance
        assert in_decibels(SENSORS[name]) == pytest.approx(decibels, abs=0.2)
    for name, (snr, wide) in sheets.items():
        well, noise = SENSORS[name].full_well, SENSORS[name].read_noise
        assert (10 * math.log10(well), 20 * math.log10(well / noise)) == pytest.approx((snr, wide), abs=0.1)
    others = {name for name, part in SENSORS.items() if part.full_well and name not in (*stated, *sheets)}
    assert others == {"OV5647", "XGS 9400", "XGS 12000"}  # which state electrons, or 40 dB
    assert 10 * math.log10(SENSORS["XGS 12000"].full_well) == pytest.approx(40)


def test_a_design_that_names_a_sensor_has_its_full_well_and_read_noise():
    sensor = roslf.loads(SCOPE).sensor
    assert (sensor.full_well, sensor.read_noise) == (10_700, 2.3)
    own = roslf.loads(SCOPE.replace('"Sony imx250"', '"IMX250"\nfull_well = 9000')).sensor
    assert (own.full_well, own.read_noise) == (9000, 2.3)
    design = roslf.loads(SCOPE)
    assert roslf.loads(roslf.dumps(design)) == design
    for part, kept in (("MT9P031", (6460, 2.0)), ("IMX226", (10_500, 2.5)), ("OV5647", (4300, 2.5))):
        other = design.replace({"sensor.part": part}).sensor
        assert (other.full_well, other.read_noise) == kept
    assert not any("full well" in one for one in roslf.evaluate(design.replace({"sensor.part": "MT9P031"})).warnings)


def test_a_study_that_chooses_a_sensor_counts_its_full_well_and_bounds_do_not_rest_on_another():
    """Quantities whose extremes are bounded before a search are those that no declared number changes."""
    base = roslf.load("rigid-scope").replace({"sensor.full_well": 5000.0})
    per_area = 5000.0 / base.sensor.pixel**2
    problem = posed({"d_2": (0.2, 20.0)}, (), goal("sigma_z_mm", "min"), design=base)
    combinations = Combinations.of(problem, load_catalogue(), ("sensors",))
    chosen = [combinations.problem_at(k).design.sensor for k in range(len(combinations))]
    held = [SENSORS[one.part].full_well or per_area * SENSORS[one.part].pixel ** 2 for one in chosen]
    assert [sensor.full_well for sensor in chosen] == pytest.approx(held, rel=1e-12)
    assert 5 < sum(SENSORS[one.part].full_well is None for one in chosen) < len(chosen)
    few, many = (
        Camera.of(base.replace({"sensor.full_well": well, "sensor.read_noise": noise}))
        for well, noise in ((4000.0, 9.0), (40_000.0, 1.0))
    )
    asked = [(one, base.d_1 if one.at == "needed" else None) for one in QUANTITIES.values() if one.of is not None]
    bounded = [(one, at) for one, at in asked if prunable(problem, goal(one.name, "max", at))]
    assert len(bounded) > 20
    for quantity, at in bounded:
        assert quantity(few, at) == pytest.approx(quantity(many, at), nan_ok=True, rel=1e-12), quantity.name


def test_a_full_well_that_nobody_states_goes_by_the_pixel_it_is_known_of():
    """By hand: 10 500 electrons are those of 3.45 um, whatever the design's pixels; 9000 are those of the design's."""
    sensor = roslf.load("rigid-scope").sensor
    for own, pixel, of in ((10_500.0, 2e-3, 3.45e-3), (10_500.0, 4e-3, 4e-3), (9_000.0, 2e-3, 2e-3)):
        known = sensor.model_copy(update={"full_well": own, "pixel": pixel})
        assert known.well_of(2.4e-3) == pytest.approx(own * (2.4e-3 / of) ** 2, rel=1e-14)


def test_sensors_are_listed_by_size_and_found_by_electrons(capsys):
    rich = read_condition("full_well>=10000")
    assert {name for name, part in SENSORS.items() if rich(part.row)} == {
        name for name, part in SENSORS.items() if part.full_well is not None and part.full_well >= 10_000
    }
    assert main(["catalogue", "--kind", "sensors"]) == 0
    lines = capsys.readouterr().out.splitlines()
    places = {name: next(k for k, line in enumerate(lines) if line.startswith(f"{name} ")) for name in SENSORS}
    assert sorted(SENSORS, key=places.__getitem__) == sorted(SENSORS, key=lambda name: SENSORS[name].size)
    assert main(["catalogue", "--where", "read_noise<=few"]) == 2
    assert 'write e.g. "read_noise>=5000"' in capsys.readouterr().err
