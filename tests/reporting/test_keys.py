"""Every key of every file is in the tables that `roslf keys` and the reference pages print."""

import json
import tomllib
from typing import get_args

import pytest
from pydantic import BaseModel

from roslf_design.cli import main
from roslf_design.errors import InputError
from roslf_design.reporting.keys import CALLED, FILES, NEEDED, TABLES, looked_up


def models_in(hint):
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        yield hint
    for part in get_args(hint):
        yield from models_in(part)


def test_every_table_inside_a_table_is_listed():
    listed = {table.model for table in TABLES}
    for table in TABLES:
        inside = {model for field in table.model.model_fields.values() for model in models_in(field.annotation)}
        assert inside <= listed, table.place


def test_every_key_is_described_and_named_as_a_file_has_it():
    for table in TABLES:
        keys = table.rows()
        assert [key.name for key in keys] == [f.alias or n for n, f in table.model.model_fields.items()], table.place
        assert all(key.takes and key.default and len(key.meaning) > 1 for key in keys), table.place


def leaves(data, *way):
    for key, value in data.items():
        tables = value if isinstance(value, list) else [value]
        if all(isinstance(one, dict) for one in tables) and tables:
            for one in tables:
                yield from leaves(one, *way, key)
        else:
            yield [*way, key]


@pytest.mark.parametrize(
    ("file", "pattern", "open_tables"),
    [
        ("design", "designs/*.toml", {"required", "material", "prescription"}),
        ("tolerance", "studies/tolerance-*/study.toml", set()),
        ("optimize", "studies/optimize-*/study.toml", {"variables", "where", "only"}),
        ("story", "studies/*/story.toml", {"sigma"}),
        ("lens", "roslf_design/lenses/shipped/*.toml", {"glasses"}),
    ],
)
def test_keys_of_files_that_ship_are_found(root, file, pattern, open_tables):
    ways = {tuple(way) for path in root.glob(pattern) for way in leaves(tomllib.loads(path.read_text()))}
    for way in ways:
        assert open_tables & set(way[:-1]) or looked_up(".".join([file, *way])), way
    assert len(ways) > 5


def test_default_and_range_are_those_that_the_reader_holds():
    ((_, (key,)),) = looked_up("light.reflectance")
    assert (key.takes, key.default) == ("number > 0, ≤ 1".replace(" 0", "\u00a00").replace(" 1", "\u00a01"), "`0.3`")
    ((_, (key,)),) = looked_up("sensor.pixel")
    assert key.default == NEEDED


@pytest.mark.parametrize(
    ("name", "near"), [("main_lense", "main_lens"), ("sensor.pixl", "sensor.pixel"), ("zzz", "roslf keys")]
)
def test_what_is_no_name_is_told_with_the_nearest(name, near, capsys):
    with pytest.raises(InputError, match=near):
        looked_up(name)
    assert main(["keys", name]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert near in err
    assert len(err.splitlines()) == 1


def test_printed_by_name_and_all(capsys):
    assert main(["keys"]) == 0
    every = capsys.readouterr().out
    assert all(table.place in every for table in TABLES)
    assert main(["keys", "sensor", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)["tables"]
    assert [table["table"] for table in tables] == ["design.sensor", "design.sensor.cover"]
    assert main(["keys", "elements.0.thickness"]) == 0
    out = capsys.readouterr().out
    assert "design.elements.plate" in out
    assert "Units of length: nm, um" in out
    assert "Also about" not in out
    assert main(["keys", "window"]) == 0  # of depth, by name; of glass, by what a plate is
    assert "Also about window: roslf keys design.elements.plate," in capsys.readouterr().out
    assert set(FILES) >= {"design", "scene", "tolerance", "optimize", "story", "bench"}


def test_a_key_whose_table_is_of_several_kinds_says_where_those_are(capsys):
    assert main(["keys", "scene.objects.plane.texture"]) == 0
    assert "roslf keys scene.texture.noise" in capsys.readouterr().out
    assert main(["keys", "scene.objects.plane.texture.noise"]) == 0
    assert "scene.texture.noise: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("word", "places"),
    [
        ("study", {"tolerance", "optimize"}),
        ("study.design", {"tolerance", "optimize"}),
        ("optimisation", {"optimize"}),
        ("limits", {"design.required", "tolerance.goals", "optimize.constraints"}),
        ("compensator", {"tolerance.compensators"}),
        ("objective", {"design.elements.lens"}),
        ("d_3", {"design.aperture"}),
        ("D_F", {"design.aperture"}),
    ],
)
def test_words_of_the_guides_lead_to_what_files_call_so(word, places):
    assert places <= {table.place for table, _ in looked_up(word)}


def test_every_word_of_the_guides_leads_somewhere():
    for word in CALLED:
        assert looked_up(word), word
