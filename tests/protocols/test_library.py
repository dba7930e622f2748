"""The protocols that come with the package say what the papers say."""

import json
from pathlib import Path

import pytest

from protocols import Limits, ProtocolError, Range, Setpoints, compile_protocol, dump, find, json_schema, library, load

LIMITS = Limits({"pressure": Range(-50e3, 0.0), **{f"probe_{a}": Range(-3e-3, 3e-3, 20e-3) for a in "xyz"}}, "hardware")


def setpoints(name: str) -> Setpoints:
    return compile_protocol(load(find(name)), LIMITS)


@pytest.mark.parametrize("name", library())
def test_each_compiles_round_trips_and_is_named_as_its_file(name: str) -> None:
    protocol = load(library()[name])
    assert protocol.name == name
    assert protocol.title
    assert protocol.source
    assert load(dump(protocol)) == protocol
    assert compile_protocol(protocol, LIMITS).duration > 0


def test_fingertip_levels() -> None:
    plateaus = [s for s in setpoints("fingertip-levels").segments if s.phase == "hold"]
    assert [-s.end["pressure"] / 100 for s in plateaus] == [150, 200, 250, 300, 350, 400, 450]
    assert {s.duration for s in plateaus} == {60}
    assert setpoints("fingertip-levels").duration == 7 * 75
    assert setpoints("fingertip-ten-cycles").duration == 10 * 7 * 75


@pytest.mark.parametrize(
    ("name", "level", "hold"),
    [("cutometer-instant-300", 300, 60), ("cutometer-instant-500", 500, 60)]
    + [(f"aspiration-instant-{level}", level, 31) for level in (66, 133, 200)],
)
def test_instant_loading_four_times_45_s_apart(name: str, level: float, hold: float) -> None:
    segments = setpoints(name).segments
    plateaus = [s for s in segments if s.phase == "hold"]
    assert [s.labels["repeat"] for s in plateaus] == ["1", "2", "3", "4"]
    assert {(s.duration, -s.end["pressure"] / 100) for s in plateaus} == {(hold, level)}
    assert [s.duration for s in segments if s.phase == "rest"][-4:] == [45] * 4


@pytest.mark.parametrize(
    ("name", "rate", "leg"),
    [(f"cutometer-linear-{r}", r, 17.5) for r in (10, 15, 20)]
    + [(f"aspiration-linear-{r}", r, 10) for r in (15, 20, 30)],
)
def test_linear_loading(name: str, rate: float, leg: float) -> None:
    legs = [s for s in setpoints(name).segments if s.phase == "load"]
    assert len(legs) == 4
    assert {s.duration for s in legs} == {leg}
    assert legs[0].end["pressure"] == pytest.approx(-100 * rate * leg)


@pytest.mark.parametrize("name", [n for n in library() if "cyclic" in n])
def test_cyclic_loading_is_three_with_3_s_between(name: str) -> None:
    segments = setpoints(name).segments
    assert {s.labels["cycle"] for s in segments if "cycle" in s.labels} == {"1", "2", "3"}
    assert [s.duration for s in segments if s.phase == "rest" and "cycle" in s.labels] == [3, 3, 3]


@pytest.mark.parametrize(("name", "directions"), [("microrobot-face", 16), ("microrobot-arm", 11)])
def test_robot_directions(name: str, directions: int) -> None:
    segments = setpoints(name).segments
    assert len({s.labels["direction"] for s in segments}) == directions
    assert setpoints(name).duration == pytest.approx(directions * 3 * 10)
    assert all(abs(v) <= 1.3e-3 + 1e-12 for s in segments for v in s.end.values())


@pytest.mark.parametrize("name", ["demo-cutometer", "demo-aspiration", "demo-microrobot"])
def test_demos_are_short(name: str) -> None:
    assert 20 <= setpoints(name).duration <= 40


def test_find_takes_paths_and_names(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(find("demo-cutometer").read_text())
    assert find(mine) == mine
    assert find("demo-cutometer.yaml") == library()["demo-cutometer"]
    with pytest.raises(ProtocolError, match="did you mean 'demo-cutometer'"):
        find("demo-cutometre")


def test_the_json_schema_knows_every_key() -> None:
    schema = json_schema()
    json.dumps(schema)
    assert {"schema", "name", "instrument", "setup", "limits", "steps"} <= set(schema["properties"])
    assert schema["additionalProperties"] is False
    assert {"Hold", "Ramp", "Cycle", "Wait", "Trajectory", "Group"} <= set(schema["$defs"])


def test_the_example_in_the_documentation_compiles() -> None:
    page = (Path(__file__).parents[2] / "docs" / "protocols.md").read_text()
    example = page.split("```yaml\n")[1].split("```")[0]
    limits = LIMITS.intersect(Limits({"pressure": Range(-40e3, 0)}, "station"))
    # 2 s; four times 60 s + 45 s; 350 mbar at 20 mbar/s; 10 s; three triangles of 2 x 17.5 s
    assert compile_protocol(load(example), limits).duration == pytest.approx(2 + 4 * 105 + 17.5 + 10 + 3 * 35)


def test_what_is_not_there_is_told_in_a_line() -> None:
    """A path that is gone is no misspelt name; a name like none of them is not answered by a list of them all."""
    with pytest.raises(ProtocolError, match=r"no such file$"):
        find("somewhere/gone.yaml")
    with pytest.raises(ProtocolError, match=rf"'acquire check' lists its {len(library())}$"):
        find("zzz")
    with pytest.raises(ProtocolError, match="did you mean 'demo-cutometer'"):
        find("demo-cutometre")
