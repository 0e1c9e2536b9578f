"""Links bring a state back, and bad ones say so."""

import base64
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roslf_design.design import load, preset_names
from roslf_design.explorer.link import LIMIT, TABS, WHOLE, LinkError, Look, decode, encode
from roslf_design.explorer.state import edit, follow, start

places = st.sampled_from(["centre", "edge", "corner"]) | st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
looks = st.builds(Look, st.sampled_from(list(TABS)), places, st.booleans(), st.booleans(), st.sampled_from(list(WHOLE)))


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_comes_back_from_its_link(name):
    state = start(load(name))
    back, look = decode(encode(state, Look()))
    assert (back, look) == (state, Look())


@given(looks, st.floats(0.1, 20), st.sampled_from(["f", "d_1", "d_f"]))
def test_a_link_brings_back_design_reference_follower_and_look(look, diameter, follower):
    state = follow(edit(start(load("paper")), "D_F", f"{diameter!r} mm"), follower)
    text = encode(state, look)
    assert decode(text) == (state, look)
    assert text.isascii()
    assert set(text) <= set("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_")


def test_a_link_is_short_enough_to_send():
    assert len(encode(start(load("paper")), Look())) < 1000


GOOD = encode(start(load("paper")), Look())


@given(st.integers(0, len(GOOD) - 1))
def test_a_link_cut_off_anywhere_is_refused(end):
    with pytest.raises(LinkError):
        decode(GOOD[:end])


@given(st.text(max_size=60) | st.text(alphabet="ABCabc123-_", max_size=60).map(lambda text: "1" + text))
def test_whatever_is_no_link_is_refused_in_one_way(text):
    with pytest.raises(LinkError):
        decode(text)


@given(st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=5), st.lists, max_leaves=8))
def test_links_with_other_content_are_refused(content):
    import json

    wrong = {"design": content, "follows": content, "look": content}
    packed = base64.urlsafe_b64encode(zlib.compress(json.dumps(wrong).encode())).decode().rstrip("=")
    with pytest.raises(LinkError):
        decode("1" + packed)


def test_a_link_that_would_fill_the_memory_is_refused():
    packed = base64.urlsafe_b64encode(zlib.compress(b" " * (20 * LIMIT), 9)).decode().rstrip("=")
    assert len(packed) < 10_000
    with pytest.raises(LinkError):
        decode("1" + packed)


def test_a_link_with_a_design_that_cannot_be_says_what_is_wrong():
    import json

    text = 'name = "x"\n[main_lens]\ndiameter = 3\n'
    content = {"design": text, "follows": "d_f", "look": {}}
    packed = base64.urlsafe_b64encode(zlib.compress(json.dumps(content).encode())).decode().rstrip("=")
    with pytest.raises(LinkError, match=r"main_lens.diameter: 3 has no unit"):
        decode("1" + packed)
