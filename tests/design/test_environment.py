"""Temperature: lengths, curvatures and indices against formulas written out here, makers' tables, and traced rays."""

import re
import tomllib

import mpmath
import numpy as np
import pytest
import tomli_w

from roslf_design import Camera, DesignError, evaluate, load, loads
from roslf_design.design.files import WRITTEN, dumps
from roslf_design.errors import InputError
from roslf_design.lenses.glass import find_glass
from roslf_design.lenses.lens_file import _loads_lens, load_lens, table_of
from roslf_design.lenses.prescription import first_order
from roslf_design.lenses.solid import find_solid
from roslf_design.optimization import Constraint
from roslf_design.tolerancing.metrics import Question, builds_of, evaluate_builds
from roslf_design.tolerancing.result import analyse
from roslf_design.tolerancing.run import tally_chunk
from roslf_design.tolerancing.sensitivities import sensitivity
from roslf_design.tolerancing.study import make_plan, read_study, tolerance_plan
from roslf_design.tolerancing.trials import differences
from tests.tolerancing.alone import apart

TEMPERATURE = "environment.temperature"
E_LINE, G_LINE, INFRARED = 546.0740e-6, 435.8343e-6, 1060e-6
STEEL = 17.2e-6


def warm(name, degrees=37.0, housing="stainless steel", **more):
    keys = "".join(f"{key} = {value}\n" for key, value in more.items())
    return loads(dumps(load(name)) + f'\n[environment]\ntemperature = "{degrees} degC"\nhousing = "{housing}"\n{keys}')


def air(micrometres, degrees):
    """Kohlrausch's formula, as SCHOTT's TIE-19 prints it."""
    square = mpmath.mpf(micrometres) ** 2
    at_15 = 6432.8 + 2949810 * square / (146 * square - 1) + 25540 * square / (41 * square - 1)
    return 1 + at_15 * mpmath.mpf("1e-8") / (1 + (degrees - 15) * mpmath.mpf("3.4785e-3"))


def bk7(micrometres, degrees):
    """N-BK7 relative to air by the catalogue's Sellmeier and thermal constants, typed from its data sheet."""
    square, t = mpmath.mpf(micrometres) ** 2, mpmath.mpf(degrees) - 20
    terms = (1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)
    n = mpmath.sqrt(1 + sum(b * square / (square - c) for b, c in terms))
    d = 1.86e-6 * t + 1.31e-8 * t**2 - 1.37e-11 * t**3 + (4.34e-7 * t + 6.27e-10 * t**2) / (square - 0.170**2)
    absolute = n * air(micrometres, 20) + (n**2 - 1) / (2 * n) * d
    return absolute / air(micrometres, degrees)


@pytest.mark.parametrize("degrees", [-40.0, 0.0, 37.0, 134.0])
def test_schotts_formula_by_its_constants(degrees):
    for line in (E_LINE, 550e-6, INFRARED):
        own = float(find_glass("N-BK7").index(line, degrees))
        assert own == pytest.approx(float(bk7(line * 1e3, degrees)), abs=3e-16)
        assert float(find_glass("N-BK7").at(degrees).index(line)) == own


@pytest.mark.parametrize(
    ("middle", "relative", "absolute"),
    [(-30, (2.4, 2.9, 3.3), (0.3, 0.8, 1.2)), (30, (2.4, 3.0, 3.5), (1.1, 1.6, 2.1)),
     (70, (2.5, 3.1, 3.7), (1.5, 2.1, 2.7))],
)  # fmt: skip
def test_dn_dt_of_n_bk7_as_its_data_sheet_prints_it(middle, relative, absolute):
    # 1e-6/K, means over 20 K at 1060 nm, e and g; printed to a tenth.
    glass = find_glass("N-BK7")
    for line, to_air, to_vacuum in zip((INFRARED, E_LINE, G_LINE), relative, absolute, strict=True):
        ends = [(float(glass.index(line, t)), float(air(line * 1e3, t))) for t in (middle - 10, middle + 10)]
        assert 1e6 * (ends[1][0] - ends[0][0]) / 20 == pytest.approx(to_air, abs=0.0501)
        assert 1e6 * (ends[1][0] * ends[1][1] - ends[0][0] * ends[0][1]) / 20 == pytest.approx(to_vacuum, abs=0.0501)


def test_water_as_measured_and_as_tabled():
    water = find_glass("water")
    # Daimon and Masumura's own Sellmeier constants at 24.0 C; they told 1e-5.
    terms = (5.666959820e-1, 5.084151894e-3), (1.731900098e-1, 1.818488474e-2)
    terms += (2.095951857e-2, 2.625439472e-2), (1.125228406e-1, 1.073842352e1)
    for nanometres in (435.8, 546.1, 589.3, 656.3):
        square = (nanometres * 1e-3) ** 2
        measured = np.sqrt(1 + sum(b * square / (square - c) for b, c in terms)) / float(air(nanometres * 1e-3, 24))
        assert float(water.index(nanometres * 1e-6, 24.0)) == pytest.approx(measured, abs=2e-5)
    # CRC Handbook, sodium line, relative to air: 1.33299 at 20, 1.33051 at 40 and 1.32718 at 60 degrees C.
    for degrees, told in ((20, 1.33299), (40, 1.33051), (60, 1.32718)):
        assert float(water.index(589.3e-6, degrees)) == pytest.approx(told, abs=1e-4)
    change = find_glass("saline").index(550e-6, 37) - find_glass("saline").index(550e-6)
    assert change == pytest.approx(float(water.index(550e-6, 37) - water.index(550e-6)), abs=1e-7)


def test_constant_rates_and_what_is_not_known():
    sapphire, plastic = find_glass("sapphire"), find_glass("PMMA")
    assert float(sapphire.index(550e-6, 37) - sapphire.index(550e-6)) == pytest.approx(17 * 13.1e-6, rel=1e-9)
    absolute = [plastic.index(550e-6, t) * float(air(0.55, t)) for t in (20, 60)]
    assert absolute[1] - absolute[0] == pytest.approx(40 * -8.5e-5, rel=1e-9)
    cover = find_glass("D263")
    assert cover.at(134) is cover
    assert cover.index(550e-6, 134) == cover.index(550e-6)
    assert cover.grown(20, 120) == pytest.approx(1 + 7.2e-4)


def test_a_glass_without_a_name_is_called_one():
    known = tomllib.loads(dumps(load("cystoscope")))
    known["elements"][0]["material"] = {"index": 1.62, "abbe": 60.32}
    known["environment"] = {"temperature": "37 degC"}
    (told,) = [one for one in evaluate(loads(tomli_w.dumps(known))).warnings if "changes with temperature" in one]
    assert "index of the glass with n = 1.62, V = 60.32 changes" in told


def test_an_aluminium_tube_and_a_lens_of_n_bk7():
    design = warm("paper", housing="aluminium")
    d_1 = 140 * (1 + 23.6e-6 * 17)
    assert design.d_1 == pytest.approx(d_1, rel=1e-15)
    assert design.d_f == pytest.approx(1 / (1 / 100 - 1 / d_1), rel=1e-13)
    assert design.d_f - 350 == pytest.approx(-0.35, abs=0.001)
    lens = loads(dumps(load("paper")).replace("[main_lens]", '[main_lens]\nmaterial = "N-BK7"')).at_temperature(37)
    grown = (1 + 7.1e-6 * 17) * (bk7(0.55, 20) - 1) / (bk7(0.55, 37) - 1)
    assert lens.f == pytest.approx(100 * float(grown), rel=1e-14)
    assert 1e3 * (lens.f - 100) == pytest.approx(2, abs=0.5)  # um


def test_nothing_changes_without_an_environment():
    for name in ("paper", "arthroscope", "paper-singlet"):
        plain = load(name)
        assert plain.environment is None
        assert TEMPERATURE not in Camera.of(plain).numbers
        at_room = Camera.of(plain.at_temperature(20.0))
        assert all(at_room[place] == value for place, value in Camera.of(plain).numbers.items())


@pytest.mark.parametrize("name", ["arthroscope", "cystoscope", "paper-singlet", "grin-needle"])
def test_designs_and_cameras_warm_by_one_rule(name):
    cold, hot = warm(name, 20), warm(name, 60)
    both = Camera.of(cold, {TEMPERATURE: np.array([20.0, 60.0])})
    for place, value in Camera.of(hot).numbers.items():
        assert both.build(1)[place] == pytest.approx(value, rel=3e-15, abs=1e-15), place
    assert hot.at_temperature(20).d_f == pytest.approx(cold.d_f, rel=1e-12)
    assert loads(dumps(hot)) == hot


@pytest.mark.parametrize("name", ["paper", "paper-singlet", "arthroscope"])
def test_files_for_workshops_have_sizes_as_drawings_do(name):
    """The numbers that the file had, whatever the camera is used at; read again, they make the camera in use."""
    hot, drawn = warm(name, 60, "titanium"), dumps(load(name), WRITTEN)
    written = dumps(hot, WRITTEN)
    assert "reference" not in written
    found, wanted = tomllib.loads(written), tomllib.loads(drawn)
    for key in ("aperture", "elements", "sensor"):
        assert found.get(key) == wanted.get(key)
    assert found["main_lens"].get("prescription") == wanted["main_lens"].get("prescription")
    again = loads(written)
    assert [getattr(again, key) for key in ("D", "f", "d_f", "d_1", "D_F", "d_3", "d", "d_2", "q")] == pytest.approx(
        [getattr(hot, key) for key in ("D", "f", "d_f", "d_1", "D_F", "d_3", "d", "d_2", "q")], rel=1e-11
    )


def test_glass_keeps_touching_what_it_touches():
    # Substrate on sensor, window soldered behind the prism's gap: nothing runs into another however it grows.
    for housing in ("invar", "aluminium"):
        design = warm("arthroscope", 134, housing)
        assert bool(Camera.of(design).valid)
        assert design.d_2 == pytest.approx(0.19 * (1 + 0.5e-6 * 114), rel=1e-15)
        prism, window = design.elements
        own = find_solid(housing).expansion
        assert prism.distance == pytest.approx(0.6 * (1 + own * 114), rel=1e-14)
        assert window.distance == pytest.approx(0.6 + 0.2 + 3.2 + 114 * (0.8 * own + 3.2 * 7.37e-6), rel=1e-14)


def test_a_real_lens_by_its_surfaces():
    # A plano-convex lens by hand: R and thickness grow, f = R/(n - 1), the back focus less a reduced thickness.
    lens, degrees = load_lens("LA1050-A"), 60.0
    hot, grown = lens.warmed(degrees), 1 + 7.1e-6 * 40
    n = float(bk7(0.55, degrees))
    front = lens.surfaces[0]
    assert first_order(hot, 550e-6).focal_length == pytest.approx(front.radius * grown / (n - 1), rel=1e-12)
    assert hot.surfaces[0].thickness == pytest.approx(front.thickness * grown, rel=1e-15)
    assert _loads_lens(tomli_w.dumps(table_of(hot))) == hot
    design = warm("paper-singlet", degrees)
    plain = load("paper-singlet")
    gap = [first_order(d.lens, d.wavelength).rear_principal - d.lens.length + d.d_1 for d in (plain, design)]
    assert gap[1] == pytest.approx(gap[0] * (1 + STEEL * 40), rel=1e-12)  # last vertex to the array: the housing's
    assert first_order(lens.warmed(degrees).reversed(), 550e-6).focal_length == pytest.approx(
        first_order(lens.reversed().warmed(degrees), 550e-6).focal_length, rel=1e-14
    )


def test_builds_of_a_real_lens_are_the_designs_traced():
    design = warm("paper-singlet", 20)
    question = Question(design, ("centre_error_px", "image_diameter_px"), ((8.0, 0.0),), design.d_f)
    values = {TEMPERATURE: np.array([5.0, 60.0]), "main_lens.surfaces.1.thickness": np.array([9.7, 9.65])}
    builds, valid = builds_of(question, values, 2)
    assert valid.all()
    check = apart(design, builds, values)
    # Where the array stands is measured from the lens as drawn there and as made here: 0.05 mm * 17e-6 * 40.
    assert check.centre_px < 1e-4
    assert check.diameter_share < 1e-6


def test_builds_behind_an_ideal_lens_and_limits_at_a_temperature():
    design = warm("paper", 20, "aluminium")
    question = Question(design, ("depth_error_mm", "fill_factor"), ((5.0, 0.0),), 350.0)
    depth, fill = evaluate_builds(question, {TEMPERATURE: np.array([20.0, 37.0])}, 2)
    hot = warm("paper", 37, "aluminium")
    assert fill[1] == pytest.approx(fill_of(hot), rel=1e-13)
    assert abs(depth[0]) < 1e-9 < abs(depth[1])
    limit = Constraint.model_validate({"quantity": "fill_factor", "max": 1.1, "temperature": 37.0})
    assert float(limit.values(Camera.of(design))) == pytest.approx(float(fill[1]), rel=1e-13)


def test_derivatives_by_temperature_are_exact():
    design = loads(dumps(warm("arthroscope", 37)).replace("[main_lens]", '[main_lens]\nmaterial = "N-BK7"'))
    data = {"name": "warmth", "trials": 16, "perturb": [{"place": TEMPERATURE, "tolerance": "10 K"}]}
    data["goals"] = [{"metric": name, "max": 1e9} for name in ("fill_factor", "image_diameter_mm", "sigma_z_mm")]
    plan, *_ = tolerance_plan(data, design)
    slopes = sensitivity(plan).exact
    central = differences(plan, [(TEMPERATURE, 0.5)])
    known = np.isfinite(slopes)
    assert known.sum() >= 2
    assert np.all(slopes[known] != 0)
    np.testing.assert_allclose(slopes[known], central[known], rtol=1e-4)  # half a kelvin bends it by so much


def fill_of(design):
    return float(evaluate_builds(Question(design, ("fill_factor",), ((0.0, 0.0),), design.d_f), {}, 1)[0, 0])


def test_evaluation_tells_the_range():
    result = evaluate(warm("arthroscope", 37, "titanium", range='["20 degC", "134 degC"]')).temperature
    assert [row.temperature_degc for row in result.at] == [20.0, 37.0, 134.0]
    cold = evaluate(warm("arthroscope", 37, "titanium", calibrated_at='"23 degC"'))
    assert [row.temperature_degc for row in cold.temperature.at] == [20.0, 23.0, 37.0]
    assert cold.to_dict()["depth"]["expected"]["calibrated_at_degc"] == 23.0
    assert all(row.fits for row in result.at)
    assert result.at[1].focus_shift_pitches == 0
    assert result.not_named == ("the main lens",)
    assert evaluate("paper").temperature is None
    assert "temperature" not in evaluate("paper").to_dict()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('temperature = 37', 'has no unit'),
        ('temperature = "310 K"', 'write "36.85 degC"'),
        ('temperature = "5 C"', 'write "5 degC"'),
        ('temperature = "86 degF"', 'write "30 degC"'),
        ('temperature = "1e400 K"', "'K' is a unit of temperature difference"),
        ('temperature = "400 degC"', "environment.temperature"),
        ('housing = "aluminum foil"', "is no material with a known expansion; did you mean 'aluminum'?"),
        ('housing = {expansion = "x"}', "per K"),
        ('range = ["40 degC", "10 degC"]', "does not rise"),
        ('reference = "20 mm"', "is a unit of length"),
        ('calibrated_at = 20', "calibrated_at: 20 has no unit"),
        ('calibrated_at = "400 degC"', "environment.calibrated_at"),
        ('colour = 1', "is not a known key"),
    ],
)  # fmt: skip
def test_bad_environments_are_told(text, message):
    with pytest.raises(DesignError) as error:
        loads(dumps(load("paper")) + f"\n[environment]\n{text}\n")
    assert "environment" in str(error.value)
    assert message in str(error.value)


def test_water_does_not_freeze_and_a_prescription_knows_its_glass():
    with pytest.raises(DesignError, match="outside what is known of saline"):
        warm("arthroscope", -5)
    with pytest.raises(DesignError, match=r"range\.2: 145 degC is outside what is known of N-LASF9"):
        warm("arthroscope", 20, range='["0 degC", "145 degC"]')
    with pytest.raises(DesignError, match=r"calibrated_at: -5 degC is outside what is known of saline"):
        warm("arthroscope", 37, calibrated_at='"-5 degC"')
    text = dumps(load("paper-singlet")).replace("[main_lens]", '[main_lens]\nmaterial = "N-BK7"')
    with pytest.raises(DesignError, match="the prescription says what the lens is made of"):
        loads(text)


def test_builds_beyond_liquid_water_are_no_cameras_and_say_so():
    camera = Camera.of(warm("cystoscope", 37)).replace({"environment.temperature": np.array([-5.0, 5.0, 120.0])})
    assert camera.valid.tolist() == [False, True, True]
    (words,) = (words for words, flags in camera.faults().items() if flags.any())
    assert words == "a temperature outside what is known of water (0 to 150 degC)"


@pytest.mark.parametrize(
    ("tolerance", "fault"), [("60 K", "37 +- 60 degC reaches -23 to 97 degC, beyond"), ("30 K", "")]
)
def test_a_study_beyond_liquid_water_is_refused_before_it_begins_or_ends(tolerance, fault):
    """Wider tolerances than the study's own are tried at its end: what freezes is no camera there."""
    goals = [{"quantity": "fill_factor", "min": 0.5, "max": 1.5}]
    perturb = [{"place": "environment.temperature", "tolerance": tolerance}]
    data = {"name": "hot", "design": "", "trials": 64, "sobol_samples": 0, "goals": goals, "perturb": perturb}
    design = warm("cystoscope", 37)
    if fault:
        with pytest.raises(InputError, match=re.escape(fault)) as error:
            read_plan(data, design)
        assert error.value.problems[0].key == "perturb.0.tolerance"
        assert "water (0 to 150 degC); take a tolerance" in str(error.value)
        return
    result = analyse(*read_plan(data, design))
    assert "water (0 to 150 degC)" in result.allowed[0].alone_limited_by
    assert result.allowed[0].alone == pytest.approx(37.0, rel=1e-3)


def read_plan(data, design):
    """Plan of a study with what its analysis takes."""
    study, _, grades = read_study(data, design=design)
    plan = make_plan(study, design, grades)
    return plan, study, grades, tally_chunk(plan, 0)


def test_lengths_before_a_real_lens_come_back_from_heat_as_they_were_written():
    """They count from its principal plane, not from its vertex: what ends between both grows with its own glass."""
    prism = {"kind": "prism", "distance": "1.4 mm", "thickness": "4 mm", "material": "N-LASF9", "diameter": "4 mm"}
    window = {"kind": "plate", "distance": "5.5 mm", "thickness": "0.5 mm", "material": "sapphire"}
    table = {
        "name": "laryngoscope",
        "main_lens": {"part": "45-089", "focal_plane": "45.9 mm"},
        "aperture": {"diameter": "0.85 mm", "distance": "1.2 mm"},
        "elements": [{**prism, "reflections": 1, "deviation": "70 deg"}, window],
        "microlens_array": {"pitch": "23.2 um", "focal_length": "170 um", "size": ["5.5 mm", "3 mm"]},
        "sensor": {"part": "IMX290", "distance": "170 um"},
        "environment": {"temperature": "37 degC", "housing": "stainless steel"},
    }
    warm = loads(tomli_w.dumps(table))
    assert abs(warm.elements[1].distance - 5.5) > 1e-5
    assert warm.at_room.elements[1].distance == pytest.approx(5.5, rel=1e-12)


TUBED = """
name = "port"
main_lens = {{focal_length = "50 mm", diameter = "20 mm", focal_plane = "200 mm"}}
aperture = {{diameter = "4 mm", distance = "55 mm"}}
stops = [{{diameter = "11 mm", distance = "6 mm"}}, {{diameter = "10 mm", distance = "10 mm", bore = true}}]
elements = [{{kind = "plate", distance = "97 mm", thickness = "3 mm", material = "N-BK7", diameter = "9 mm"}}]
microlens_array = {{pitch = "45 um", focal_length = "450 um", size = ["9 mm", "9 mm"]}}
sensor = {{distance = "450 um", pixel = "3 um", size = ["9 mm", "9 mm"]}}
environment = {{temperature = "{degrees} degC", housing = {housing}}}
tube = {{outer_diameter = "14 mm", wall = "2 mm", length = "90 mm"{material}}}
"""
TITANIUM, GLASS = 8.6e-6, 7.1e-6


@pytest.mark.parametrize("degrees", [-40.0, 80.0])
def test_a_tube_of_another_material_than_its_head(degrees):
    """By hand: it ends 10 mm before the lens, so that a stop there stands on the head, and what is beyond on both."""
    titanium, steel = (f"{{expansion = {a}}}" for a in (TITANIUM, STEEL))

    def design(housing, material="", degrees=degrees):
        return loads(TUBED.format(degrees=degrees, housing=housing, material=material))

    both, t = design(steel, f", material = {titanium}"), degrees - 20
    head, tube, glass = (1 + a * t for a in (STEEL, TITANIUM, GLASS))
    assert both.d_3 == pytest.approx(10 * head + 45 * tube, rel=1e-12)
    assert [stop.distance for stop in both.stops] == pytest.approx([6 * head, 10 * head], rel=1e-12)
    assert both.elements[0].distance == pytest.approx(10 * head + 87 * tube, rel=1e-12)
    assert both.elements[0].thickness == pytest.approx(3 * glass, rel=1e-9)
    assert both.aperture.diameter == pytest.approx(4 * tube, rel=1e-12)
    assert both.tube.outer_diameter == pytest.approx(14 * tube, rel=1e-12)
    assert [stop.diameter for stop in both.stops] == pytest.approx([11 * head, 10 * tube], rel=1e-12)
    assert both.d_1 == pytest.approx(design(steel).d_1, rel=1e-12)
    assert both.d_2 == pytest.approx(design(steel).d_2, rel=1e-12)
    assert loads(dumps(both)) == both
    cold = design(steel, f", material = {titanium}", 20.0)
    builds = Camera.of(cold).replace({TEMPERATURE: np.array([20.0, degrees])})
    assert builds["aperture.distance"] == pytest.approx([55, 10 * head + 45 * tube], rel=1e-12)
    assert "tube of" in evaluate(both).temperature.held
    alike = design(titanium, f", material = {titanium}")
    assert Camera.of(alike).numbers == pytest.approx(Camera.of(design(titanium)).numbers, rel=1e-13)
    with pytest.raises(DesignError, match="give its length"):
        loads(
            TUBED.replace(', length = "90 mm"', "").format(degrees=80, housing=steel, material=f", material = {steel}")
        )


def test_a_tube_of_its_own_material_before_a_stop_behind_the_lens():
    """Of 30 mm before the lens the tube holds the outer 10; the stop behind the lens has no place before it."""
    design = load("paper").replace(
        {
            "aperture": {"behind": 20.0, "diameter": 5.0},
            "stops": [{"distance": 30.0, "diameter": 40.0}],
            "tube": {"outer_diameter": 60.0, "wall": 2.0, "length": 10.0, "material": {"expansion": STEEL}},
            "environment": {"housing": {"expansion": TITANIUM}},
        }
    )
    warm = design.at_temperature(70.0)
    assert warm.stops[0].distance == pytest.approx(20 * (1 + 50 * TITANIUM) + 10 * (1 + 50 * STEEL), rel=1e-9)
