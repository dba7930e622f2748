"""The library as a whole: complete, documented, parsed from text, extended by plugins that may be broken."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gap.blind.vocabulary import CONCEPTS, INSTRUMENTS, Instrument, concepts_of
from sim_devices import effects as library
from sim_devices.effects import broken, effects, parse_effect, variants
from sim_devices.effects.build import CHOICE
from sim_devices.stages import nominal


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_every_concept_of_the_vocabulary_has_an_effect_in_its_stage(instrument: Instrument) -> None:
    known = effects(instrument)
    assert set(concepts_of(instrument)) <= set(known)
    for name in concepts_of(instrument):
        assert known[name].stage == CONCEPTS[name].stage


def test_effects_are_documented() -> None:
    listed = effects()
    assert len({e.name for e in listed.values()}) >= 40
    assert not broken()
    for key, effect in listed.items():
        assert effect.meaning.endswith("."), key
        assert effect.remedy.endswith("."), key
        assert effect.source, key
        assert effect.strengths, key


def test_parameters_of_effects_have_ranges_units_and_words() -> None:
    for key, p in ((key, p) for key, effect in effects().items() for p in effect.parameters):
        assert p.low < p.high, (key, p.name)
        assert p.low <= p.default <= p.high, (key, p.name)
        assert p.unit, (key, p.name)
        assert p.scale != "log" or p.low > 0, (key, p.name)
        assert p.unit != CHOICE or p.name == "seed" or p.meaning.startswith("0 "), (key, p.name)


def test_keys_of_all_name_the_instrument_where_units_differ() -> None:
    listed = effects()
    assert listed["slew_limit"].instruments == ("cutometer", "aspiration")
    assert listed["slew_limit@microrobot"].instruments == ("microrobot",)
    assert effects("microrobot")["slew_limit"] is listed["slew_limit@microrobot"]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("regulator_lag", {}),
        ("regulator_lag:tau=0.3s", {"tau": 0.3}),
        ("regulator_lag: tau = 300 ms, form=1", {"tau": 0.3, "form": 1.0}),
        ("dead_band:band=8mbar", {"band": 800.0}),
        ("leak:shortfall=8 percent", {"shortfall": 0.08}),
        ("gauge_offset:offset=-500", {"offset": -500.0}),
    ],
)
def test_effects_are_read_from_text(text: str, values: dict[str, float]) -> None:
    effect, given = parse_effect(text)
    assert effect.name == text.partition(":")[0]
    assert given == pytest.approx(values)
    effect.apply(nominal("cutometer"), given)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("regulater_lag", "no effect 'regulater_lag'; there are latency"),
        ("regulator_lag:tao=1", "no parameter 'tao=1'; write parameter=value, with one of tau, form"),
        ("regulator_lag:tau", "no parameter 'tau'"),
        ("regulator_lag:tau=3mm", "tau = '3mm': a number in s is needed"),
        ("regulator_lag:form=slow", "a whole number is needed: 0 a first-order lag"),
        ("regulator_lag:tau=-1s", "effect regulator_lag, parameter tau = '-1s': it must be 0 s or more"),
        ("regulator_lag:form=9", "form = '9': it must be a whole number, 0 to "),
        ("regulator_lag:form=0.5", "form = '0.5': it must be a whole number, 0 to "),
        ("jitter:seed=-1", "seed = '-1': it must be a whole number, 0 or more"),
        ("slow_creep:tau=0s", "tau = '0s': it must be more than 0 s"),
        ("probe_recoil:tau=-0.1s", "tau = '-0.1s': it must be 0 s or more"),
        ("rim_friction:share=-0.1", "share = '-0.1': it must be 0 or more"),
    ],
)
def test_wrong_text_is_refused_by_name(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_effect(text)


def test_an_effect_of_another_instrument_is_refused() -> None:
    with pytest.raises(ValueError, match="no effect 'leak' of microrobot"):
        parse_effect("leak", "microrobot")
    with pytest.raises(ValueError, match="not for microrobot"):
        effects()["leak"].apply(nominal("microrobot"))
    assert parse_effect("sensor_gain:channel=1", "microrobot")[1] == {"channel": 1.0}


def test_variants_fix_each_choice() -> None:
    found = variants(effects("microrobot")["backlash"])
    choices = list(product(range(3), range(4)))
    assert list(found) == [f"backlash[form={form},axis={axis}]" for form, axis in choices]
    chain = nominal("microrobot")
    for (form, axis), variant in zip(choices, found.values(), strict=True):
        assert variant.name == "backlash"
        assert [p.name for p in variant.parameters] == ["gap", "spread"][: 2 if form == 2 else 1]
        assert variant.apply(chain) == effects("microrobot")["backlash"].apply(chain, {"form": form, "axis": axis})


def test_play_of_one_axis_leaves_the_others_alone() -> None:
    grid = np.arange(0.0, 2.0, 0.01)
    axes = {name: 1e-3 * np.sin(6.0 * grid) for name in ("axis_1", "axis_2", "axis_3")}
    names = list(axes)
    for form in range(3):
        v = {"gap": 2e-4, "form": form, "axis": 2}
        chain = effects("microrobot")["backlash"].apply(nominal("microrobot"), v)
        law = next(op for op in chain.operators if op.name == "backlash")
        assert law.source == (names[1],)
        signals = dict(axes)
        law.advance(law.fresh(), grid, signals)
        lost = axes[names[1]] - signals[law.target[0]]
        assert np.ptp(lost) == pytest.approx(2e-4, rel=0.02)
    assert list(variants(effects()["missing_deep_layer"])) == ["missing_deep_layer"]


def test_a_broken_plugin_is_reported_and_disturbs_nobody() -> None:
    here = __name__
    entries = [
        EntryPoint("good", f"{here}:ONE", library.GROUP),
        EntryPoint("several", f"{here}:several", library.GROUP),
        EntryPoint("gone", "no_such_module_anywhere:EFFECTS", library.GROUP),
        EntryPoint("wrong", f"{here}:WRONG", library.GROUP),
        EntryPoint("raises", f"{here}:raises", library.GROUP),
    ]
    found, errors = library._plugins(entries)
    assert [e.name for e in found] == ["leak", "latency", "leak"]
    assert set(errors) == {"gone", "wrong", "raises"}
    assert "ModuleNotFoundError" in errors["gone"]
    assert "int where effects are expected" in errors["wrong"]
    assert "ZeroDivisionError" in errors["raises"]


ONE = effects()["leak"]
WRONG = [3]


def several() -> list[object]:
    return [effects()["latency"], effects()["leak"]]


def raises() -> None:
    raise ZeroDivisionError


def test_the_effect_shown_in_the_docs_works() -> None:
    text = (Path(__file__).parents[3] / "docs" / "effects.md").read_text()
    first, second = (block.split("```")[0] for block in text.split("```python\n")[1:])
    names: dict[str, Any] = {}
    exec(first, names)
    exec(second, names)
    stamps = np.arange(0.0, 4.0, 0.01)
    table = (np.array([0.0, 1.0, 1.0, 4.0]), np.array([0.0, 0.0, -3e4, -3e4]))
    surging = names["SURGE"].apply(names["chain"], {"share": 0.05})
    pressure = names["simulate"](surging, {"pressure": table}, {"pressure": stamps})["pressure"]
    assert np.ptp(pressure[200:]) == pytest.approx(3e3, rel=0.01)


def test_a_cutometer_is_told_of_no_camera() -> None:
    for name, effect in effects("cutometer").items():
        told = f"{effect.meaning} {effect.remedy}".lower()
        assert not [word for word in ("pixel", "camera", "image", "picture") if word in told], name
