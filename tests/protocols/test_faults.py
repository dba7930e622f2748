"""Malformed protocols: each is refused with its line, its field and words that help."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols import Limits, Problem, ProtocolError, Range, compile_protocol, library, load
from protocols.source import MAX_BYTES

HEAD = "schema: protocol/1\nname: x\ninstrument: cutometer\n"
ROBOT = "schema: protocol/1\nname: x\ninstrument: microrobot\n"
SUCTION = Limits({"pressure": Range(-50e3, 0.0)}, "hardware")
TIP = Limits({f"probe_{axis}": Range(-3e-3, 3e-3, 20e-3) for axis in "xyz"}, "hardware")

# text, line, field, words of the message
UNREADABLE = {
    "empty": ("\n", 0, "", "empty"),
    "a list": ("- 1\n- 2\n", 1, "", "mapping of keys"),
    "bad yaml": (HEAD + "steps: [\n", 5, "", "not YAML"),
    "tab": (HEAD + "steps:\n\t- x\n", 5, "", "not YAML"),
    "control character": (HEAD + "title: \x01\n", 4, "", "forbidden character"),
    "alias": (HEAD + "a: &a [1]\nsteps: *a\n", 4, "", "anchors"),
    "tag": (HEAD + "steps: !!python/object:os.system {}\n", 4, "", "tags"),
    "deep": (HEAD + "steps: " + 40 * "[" + 40 * "]" + "\n", 4, "", "nested deeper"),
    "repeated key": (HEAD + "name: y\n", 4, "name", "repeated key (first in line 2)"),
    "merge": (HEAD + "<<: {a: 1}\n", 4, "", "a key must be a word"),
    "number as key": (HEAD + "1: 2\n", 4, "", "a key must be a word"),
}
INVALID = {
    "no schema": ("name: x\ninstrument: cutometer\nsteps: [{type: wait, duration: 1 s}]\n", 1, "schema", "is missing"),
    "newer schema": (HEAD.replace("/1", "/2") + "steps: [{type: wait, duration: 1 s}]\n", 1, "schema", "protocol/1"),
    "name of a path": (
        HEAD.replace("name: x", "name: ../../etc/x") + "steps: [{type: wait, duration: 1 s}]\n",
        2,
        "name",
        "'../../etc/x' cannot be a name: it takes letters (a to z, A to Z), digits",
    ),
    "typo in a key": (HEAD + "stpes: []\n", 4, "stpes", "did you mean 'steps'?"),
    "no steps": (HEAD, 1, "steps", "is missing"),
    "empty steps": (HEAD + "steps: []\n", 4, "steps", "at least one"),
    "instrument": (
        HEAD.replace("cutometer", "cutometre") + "steps: []\n",
        3,
        "instrument",
        "did you mean 'cutometer'?",
    ),
    "typo in a step": (
        HEAD + "steps:\n  - type: hold\n    suction: 300 mbar\n    durtion: 1 s\n",
        7,
        "steps[0].durtion",
        "did you mean 'duration'?",
    ),
    "typo in a direction": (
        ROBOT
        + "steps:\n  - type: trajectory\n    amplitude: 1 mm\n    frequency: 1 Hz\n    directions: [{teta: 0 deg}]\n",
        8,
        "steps[0].directions[0].teta",
        "did you mean 'theta'?",
    ),
    "step without type": (HEAD + "steps:\n  - {duration: 1 s}\n", 5, "steps[0]", "a step needs a type"),
    "unknown type": (HEAD + "steps:\n  - {type: rmap}\n", 5, "steps[0].type", "did you mean 'ramp'?"),
    "step is a word": (HEAD + "steps:\n  - hold\n", 5, "steps[0]", "expected keys and values"),
    "no unit": (HEAD + "steps:\n  - {type: wait, duration: 60}\n", 5, "steps[0].duration", "a unit is missing"),
    "wrong unit": (HEAD + "steps:\n  - {type: wait, duration: 6 mm}\n", 5, "steps[0].duration", "no unit of time"),
    "negative suction": (
        HEAD + "steps:\n  - {type: hold, suction: -300 mbar, duration: 1 s}\n",
        5,
        "steps[0].suction",
        "must not be negative",
    ),
    "zero duration": (HEAD + "steps:\n  - {type: wait, duration: 0 s}\n", 5, "steps[0].duration", "must be positive"),
    "repeat": (
        HEAD + "steps:\n  - {type: wait, duration: 1 s, repeat: 0}\n",
        5,
        "steps[0].repeat",
        "must be at least 1, not",
    ),
    "half a repeat": (
        HEAD + "steps:\n  - {type: wait, duration: 1 s, repeat: 1.5}\n",
        5,
        "steps[0].repeat",
        "a whole number",
    ),
    "two targets": (
        HEAD + "steps:\n  - {type: hold, suction: 1 mbar, pressure: -1 mbar, duration: 1 s}\n",
        5,
        "steps[0]",
        "not pressure and suction",
    ),
    "ramp without time": (
        HEAD + "steps:\n  - {type: ramp, suction: 1 mbar}\n",
        5,
        "steps[0]",
        "exactly one of duration, rate, speed",
    ),
    "overdetermined cycle": (
        HEAD + "steps:\n  - {type: cycle, suction: 1 mbar, rate: 1 mbar/s, t_lin: 1 s}\n",
        5,
        "steps[0]",
        "two of three",
    ),
    "until without a side": (
        HEAD + "steps:\n  - {type: wait, duration: 1 s, until: {channel: pressure}}\n",
        5,
        "steps[0].until",
        "exactly one of above, below",
    ),
    "until in a wrong unit": (
        HEAD + "steps:\n  - {type: wait, duration: 1 s, until: {channel: apex_height, above: 1 mbar}}\n",
        5,
        "steps[0].until",
        "no unit of length",
    ),
    "limits": (HEAD + "limits: {pressure: {low: 1 mm}}\nsteps: []\n", 4, "limits", "pressure.low"),
    "foreign setup": (
        HEAD + "setup: {hole_radius: 1 mm}\nsteps: [{type: wait, duration: 1 s}]\n",
        1,
        "",
        "the cutometer has none",
    ),
    "no list": (HEAD + "steps:\n  - {type: group, steps: }\n", 5, "steps[0].steps", "expected a list, not nothing"),
    "part of a cycle": (
        HEAD + "steps:\n  - {type: cycle, suction: 100 mbar, rate: 15 mbar/s, cycles: 1.5}\n",
        5,
        "steps[0].cycles",
        "must be a whole number, not '1.5'",
    ),
    "a million cycles": (
        HEAD + "steps:\n  - {type: cycle, suction: 100 mbar, rate: 15 mbar/s, cycles: 1000000}\n",
        5,
        "steps[0].cycles",
        "must be at most ",
    ),
    "inside a group": (
        HEAD + "steps:\n  - type: group\n    steps:\n      - {type: wait, duration: 1 s}\n      - {type: wait}\n",
        8,
        "steps[0].steps[1].duration",
        "is missing",
    ),
    "a position without its axes": (
        ROBOT + "steps:\n  - {type: ramp, position: 1 mm, speed: 1 mm/s}\n",
        5,
        "steps[0].position",
        "expected keys and values (x, y, z), not '1 mm'",
    ),
    "an opening in metres": (
        HEAD + "setup: {opening: 2 m}\nsteps: [{type: wait, duration: 1 s}]\n",
        4,
        "setup.opening",
        "must be 0.1 mm … 100 mm, not '2 m'",
    ),
    "a nanosecond": (
        HEAD + "steps: [{type: wait, duration: 1 ns}]\n",
        4,
        "steps[0].duration",
        "must be at least 0.001 s, not '1 ns'",
    ),
}
INFEASIBLE = {
    "out of limits": (
        HEAD + "steps:\n  - {type: wait, duration: 1 s}\n  - {type: hold, suction: 600 mbar, duration: 1 s}\n",
        6,
        "steps[1]",
        "-600 mbar is outside -500 mbar … 0 mbar",
    ),
    "positive": (
        HEAD + "steps:\n  - {type: hold, pressure: 300 mbar, duration: 1 s}\n",
        5,
        "steps[0]",
        "suction is negative",
    ),
    "own limits": (
        HEAD + "limits: {pressure: {rate: 10 mbar/s}}\nsteps:\n  - {type: cycle, suction: 100 mbar, rate: 15 mbar/s}\n",
        6,
        "steps[0]",
        "15 mbar/s is faster than the 10 mbar/s",
    ),
    "limits exclude each other": (
        HEAD + "limits: {pressure: {low: 1 mbar, high: 2 mbar}}\nsteps:\n  - {type: wait, duration: 1 s}\n",
        4,
        "limits",
        "exclude each other",
    ),
    "robot's position in suction": (
        HEAD + "steps:\n  - {type: hold, position: {x: 1 mm}, duration: 1 s}\n",
        5,
        "steps[0]",
        "commanded by pressure or suction",
    ),
    "trajectory in suction": (
        HEAD + "steps:\n  - {type: trajectory, directions: [{}], amplitude: 1 mm, speed: 1 mm/s}\n",
        5,
        "steps[0]",
        "no probe to move",
    ),
    "endless": (
        HEAD
        + "steps:\n  - type: group\n    repeat: 999\n    steps:\n      - {type: wait, duration: 10 ms, repeat: 999}\n",
        8,
        "steps[0].steps[0]",
        "more than 100000",
    ),
    "channel it does not have": (
        HEAD + "steps:\n  - {type: wait, duration: 1 s, until: {channel: force_z, above: 1 N}}\n",
        5,
        "steps[0].until",
        "no channel 'force_z'",
    ),
    "hold where a ramp was cut": (
        HEAD
        + "steps:\n  - {type: ramp, suction: 300 mbar, rate: 15 mbar/s, until: {channel: apex_height, above: 2 mm}}\n"
        + "  - {type: hold, duration: 1 s}\n",
        6,
        "steps[1]",
        "must say its value",
    ),
    "jumping probe": (
        ROBOT + "steps:\n  - {type: hold, position: {x: 1 mm}, duration: 1 s}\n",
        5,
        "steps[0]",
        "cannot jump",
    ),
    "speed of a pressure": (
        HEAD + "steps:\n  - {type: ramp, suction: 3 mbar, speed: 1 mm/s}\n",
        5,
        "steps[0].speed",
        "has no speed",
    ),
    "waiting off the centre": (
        ROBOT + "steps:\n  - {type: ramp, position: {x: 1 mm}, speed: 1 mm/s}\n  - {type: wait, duration: 1 s}\n",
        6,
        "steps[1]",
        "not at the centre",
    ),
    "beside the hole of the support plate": (
        ROBOT + "setup: {hole_radius: 1 mm}\nsteps:\n  - {type: ramp, position: {x: 1.5 mm}, speed: 1 mm/s}\n",
        6,
        "steps[0]",
        "goes 1.5 mm aside, in a hole of 1 mm radius",
    ),
    "nothing to do": (
        ROBOT + "steps:\n  - {type: ramp, position: {x: 0 mm}, speed: 1 mm/s}\n",
        5,
        "steps",
        "there is nothing to do",
    ),
}


def _expect(error: ProtocolError, line: int, field: str, words: str) -> None:
    problem = error.problems[0]
    assert (problem.line, problem.field) == (line, field)
    assert words in problem.message
    assert str(error).startswith(f"<text>:{line}:" if line else "<text>:")


@pytest.mark.parametrize("case", [*UNREADABLE.values(), *INVALID.values()], ids=[*UNREADABLE, *INVALID])
def test_malformed(case: tuple[str, int, str, str]) -> None:
    text, line, field, words = case
    with pytest.raises(ProtocolError) as caught:
        load(text)
    _expect(caught.value, line, field, words)


@pytest.mark.parametrize("case", INFEASIBLE.values(), ids=INFEASIBLE)
def test_infeasible(case: tuple[str, int, str, str]) -> None:
    text, line, field, words = case
    protocol = load(text)
    with pytest.raises(ProtocolError) as caught:
        compile_protocol(protocol, TIP if protocol.instrument == "microrobot" else SUCTION)
    _expect(caught.value, line, field, words)


def test_every_fault_is_reported_what_is_missing_last() -> None:
    with pytest.raises(ProtocolError) as caught:
        load(HEAD + "tilte: x\nsteps:\n  - {type: wait}\n  - {type: hold, suction: 300, duration: 1 s}\n")
    assert [p.line for p in caught.value.problems] == [4, 7, 6]


def test_without_limits_it_is_refused() -> None:
    protocol = load(HEAD + "steps:\n  - {type: wait, duration: 1 s}\n")
    with pytest.raises(ProtocolError, match="without limits nothing is armed"):
        compile_protocol(protocol, Limits())


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ProtocolError, match=r"none\.yaml: no such file"):
        load(tmp_path / "none.yaml")
    big = tmp_path / "big.yaml"
    big.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(ProtocolError, match="larger than"):
        load(big)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(HEAD.encode() + "title: Häut\n".encode("latin-1"))
    with pytest.raises(ProtocolError, match=r"latin\.yaml:4:1: not UTF-8"):
        load(latin)


LIBRARY = [path.read_text() for path in library().values()]
FRAGMENTS = [
    "[",
    "}",
    ":",
    "- ",
    "\n",
    "\t",
    "&a ",
    "*a",
    "!!x",
    "0",
    "1e999",
    ".nan",
    "~",
    "|",
    "é",
    "\x00",
    "repeat: 999\n",
]


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(LIBRARY),
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 4), st.sampled_from(FRAGMENTS)), min_size=1, max_size=4),
)
def test_a_damaged_protocol_is_either_one_still_or_refused_with_its_line(
    text: str, damages: list[tuple[float, int, str]]
) -> None:
    for place, lost, gained in damages:
        at = int(place * len(text))
        text = text[:at] + gained + text[at + lost :]
    problems: tuple[Problem, ...] = ()
    try:
        protocol = load(text + "\n")
        compile_protocol(protocol, TIP if protocol.instrument == "microrobot" else SUCTION)
    except ProtocolError as error:
        problems = error.problems
    assert all(p.line > 0 for p in problems)
