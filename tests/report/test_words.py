"""Pages speak words, study files names."""

from __future__ import annotations

import pytest

from roslf_design.design import PATHS
from roslf_design.report.words import WORDS, in_words
from roslf_design.theory.quantities import QUANTITIES
from roslf_design.tolerance.metrics import METRICS


def test_every_quantity_that_is_no_symbol_has_words():
    assert {name for name in QUANTITIES if name not in PATHS} <= set(WORDS)
    assert set(METRICS) <= set(WORDS)


@pytest.mark.parametrize("name", sorted(WORDS))
def test_words_are_found_in_sentences_and_only_once(name):
    told = in_words(f"{name} at 40 mm = 3, f_number_microlens >= 2")
    assert told == f"{WORDS[name]} at 40 mm = 3, microlens f-number d_2/d ≥ 2"
    assert in_words(told) == told


def test_symbols_and_other_words_stay():
    assert in_words("d_3 <= 6 mm, magnification_of_something") == "d_3 ≤ 6 mm, magnification_of_something"


def test_fields_of_metrics():
    assert in_words("hold fill_factor@2, kept_fraction") == "hold fill factor at field 2, kept fraction"
