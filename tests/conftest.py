"""Settings for every test: property tests draw the same examples in every run, so that green means green."""

import gc
import hashlib
import io
import math
import os
import pickle
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

gc.disable()  # until all tests are read, of which nothing goes: looking for what does takes half of that time
# Workers share the processors already: threads of linear algebra would wait for each other, spinning. Before numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Workers keep what arrays gave back: memory returned and given anew, page by page, costs up to a tenth of their time.
for limit in ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"):
    os.environ.setdefault(limit, str(1 << 30))

settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    max_examples=25,  # the same in every run: the profile below looks farther
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

from roslf_design import _jit  # noqa: E402
from roslf_design.bench import reference  # noqa: E402
from roslf_design.calibration import corners, outcome, raw  # noqa: E402
from roslf_design.calibration.white_profile import ImageFit, WhiteFrame  # noqa: E402
from roslf_design.commands import terminal  # noqa: E402
from roslf_design.depth import measure  # noqa: E402
from roslf_design.drawing.picture import Picture  # noqa: E402
from roslf_design.imaging import transfer  # noqa: E402
from tests.depth.made import fewer_rays  # noqa: E402
from tests.known import remember  # noqa: E402
from tests.reporting.made import views_as_refocused  # noqa: E402

_jit.PATIENCE.set(
    1.0
)  # [s]; what many tests call is compiled soon, interpreted no longer than one command would have it
ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config):
    """Workers begin to read tests at different places: each then finds others' files with their asserts rewritten."""
    # In pyproject.toml it would have numba, and numpy, imported before the settings above.
    config.addinivalue_line("filterwarnings", "ignore::numba.NumbaPerformanceWarning")
    worker = getattr(config, "workerinput", None)
    if worker and config.args == ["tests"]:
        places = [path for path in (ROOT / "tests").iterdir() if path.is_dir() or path.match("test_*.py")]
        names = sorted(f"tests/{path.name}" for path in places if path.name[0] not in "_.")
        start = int(worker["workerid"].removeprefix("gw")) * len(names) // worker["workercount"]
        config.args = [*names[start:], *names[:start]]


def pytest_collection_modifyitems(items):
    """Tests in a browser first: one worker then has them all, with one browser and one explorer.

    Then file by file: in the same order in every worker.
    """
    items.sort(key=lambda item: ("tests/explorer/" not in item.nodeid, item.nodeid.partition("::")[0]))


def pytest_collection_finish():
    """What is there by now stays to the end, and need not be looked through again and again."""
    gc.enable()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)  # most garbage is of pictures' texts and axes


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's folder."""
    return ROOT


@pytest.fixture(autouse=True)
def no_lines_in_logs(monkeypatch):
    """What commands say of their progress depends on how busy the machine is: not in what tests compare."""
    monkeypatch.setattr(terminal, "LOGGED", math.inf)


@pytest.fixture
def near_light(monkeypatch):
    """Diffraction brings light from 24 pixels around instead of 96: a tenth of the rays where regions are small.

    What comes from farther is still counted, as even light: for pictures that are compared with each other, or to 1 %.
    """
    monkeypatch.setattr(transfer, "LEAST_HALO", 24)
    monkeypatch.setattr(transfer, "LEAST_PITCHES", 0)


@pytest.fixture
def light_from_48_px(monkeypatch):
    """Diffraction brings light from 48 pixels around, all but 0.4 % of it: a third of the rays of small regions."""
    monkeypatch.setattr(transfer, "LEAST_HALO", 48)
    monkeypatch.setattr(transfer, "LEAST_PITCHES", 0)


@pytest.fixture(scope="session", autouse=True)
def blank_pngs():
    """One white pixel for every picture that is saved as PNG, each a tenth of a second's work; what draws them else."""
    from PIL import Image

    stream = io.BytesIO()
    Image.new("L", (1, 1), 255).save(stream, format="png")
    drawn = Picture.to_png
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Picture, "to_png", lambda *_, **__: stream.getvalue())
        yield drawn


@pytest.fixture(scope="module")
def real_pngs(blank_pngs):
    """Pictures as PNG as a user has them: where one looks at them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Picture, "to_png", blank_pngs)
        yield


@pytest.fixture
def few_rays(monkeypatch):
    """As `fewer_rays` says."""
    fewer_rays(monkeypatch)


@pytest.fixture
def without_views(monkeypatch):
    """As `views_as_refocused` says: where of data sheets nobody looks at what single views resolve."""
    views_as_refocused(monkeypatch)


@pytest.fixture
def unpredicted(monkeypatch):
    """What a texture allows is predicted at one microlens of simulated depth, not at 64: where nobody looks at it."""
    monkeypatch.setattr(measure, "PREDICTED", 1)


@pytest.fixture(scope="session", autouse=True)
def known_before():
    """What `known.PLACES` said in any test before: the presets were worked out anew in hundreds of them.

    Clear it where a test looks that twice gives the same.
    """
    known = {}
    with pytest.MonkeyPatch.context() as patch:
        remember(patch, known)
        yield known


@pytest.fixture(scope="module")
def found_once():
    """What a module's tests find in the same pixels is found once: lattice, corners, widths.

    Half of the work of a calibration. Clear it where a test looks that twice gives the same.
    """
    known = {}

    def remembered(function):
        def found(*args, **options):
            asked = hashlib.sha256(pickle.dumps((function.__qualname__, args, options))).digest()
            if asked not in known:
                known[asked] = function(*args, **options)
            return known[asked]

        return found

    with pytest.MonkeyPatch.context() as patch:
        places = [(module, "find_centres") for module in (outcome, raw, reference)]
        places += [(corners, "find_corners"), (corners, "fit_saddles")]
        places += [(ImageFit, "of"), (WhiteFrame, "profile")]
        for place, name in places:
            patch.setattr(place, name, remembered(getattr(place, name)))
        yield known


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real data beside the project; tests that need it are skipped where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no real data beside the project (../shared/data)")
    return folder
