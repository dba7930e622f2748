"""``acquire fit plan``: candidates from protocols within the limits, a table and JSON."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from acquire import plugins
from acquire.cli import app


class Solver:
    """Judges an experiment by its largest suction."""

    def models(self) -> dict[str, Any]:
        return {"suction": None}

    def experiment(self, instrument: str, time: Any, drive: Any, geometry: Any, label: str) -> Any:
        return SimpleNamespace(instrument=instrument, drive=drive, geometry=geometry)

    def plan(self, fitted: Any, parameter: str, experiments: Any) -> list[Any]:
        gains = []
        for name, (run, minutes) in experiments.items():
            size = float(-run.drive["pressure"].min()) / 1e5
            trouble = "" if run.geometry == {"opening_radius": 3e-3} else f"opening {run.geometry}"
            gains.append(
                SimpleNamespace(
                    name=name,
                    minutes=minutes,
                    deviation=1.0,
                    narrowing=size,
                    per_minute=size / minutes,
                    trouble=trouble,
                )
            )
        return gains


@pytest.fixture
def fitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    found = {"skinrig": plugins.Plugin("acquire.solvers", "skinrig", "a:b", Solver)}
    plain = plugins.plugins
    monkeypatch.setattr(plugins, "plugins", lambda group: found if group == "acquire.solvers" else plain(group))
    path = tmp_path / "fit.json"
    path.write_text(
        json.dumps({"schema": "skinrig-fit/1", "model": "suction", "recordings": [{"instrument": "cutometer"}]})
    )
    return path


def test_levels_and_openings_multiply_and_limits_leave_out(fitted: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "plan.json"
    asked = ["fit", "plan", str(fitted), "-p", "G", "--protocol", "demo-cutometer", "--levels", "0.5,1,9"]
    assert app.run([*asked, "--openings", "6,8", "-o", str(out)]) == app.DONE
    table = json.loads(out.read_text())
    assert table["schema"] == "skinrig-plan/1"
    names = [row["protocol"] for row in table["candidates"]]
    assert names == [f"demo-cutometer{x}, {d} mm" for x in (" x 0.5", "") for d in (6, 8)]
    assert [row["narrowing"] for row in table["candidates"][::2]] == pytest.approx([0.15, 0.3])
    assert table["candidates"][1]["trouble"] == "opening {'opening_radius': 0.004}"
    assert all("outside" in reason for reason in table["left_out"].values())
    assert len(table["left_out"]) == 2
    words = capsys.readouterr().out
    assert "share of its present uncertainty" in words
    assert "cannot be judged" in words


def test_the_library_of_the_instrument_is_the_default(fitted: Path, capsys: Any) -> None:
    assert app.run(["fit", "plan", str(fitted), "-p", "G", "--json"]) == app.DONE
    names = {row["protocol"] for row in json.loads(capsys.readouterr().out)["candidates"]}
    assert {"cutometer-instant-300", "demo-cutometer"} <= names
    assert not any("aspiration" in name or "microrobot" in name for name in names)


def test_the_fits_own_opening_stands_where_a_protocol_says_none(fitted: Path, tmp_path: Path, capsys: Any) -> None:
    recording = {"instrument": "cutometer", "geometry": {"opening_radius": 3e-3, "mesh": 0.5}}
    fitted.write_text(json.dumps({"schema": "skinrig-fit/1", "model": "suction", "recordings": [recording]}))
    protocol = tmp_path / "bare.yaml"
    steps = "steps: [{type: hold, suction: 200 mbar, duration: 5 s}]"
    protocol.write_text(f"schema: protocol/1\nname: bare\ninstrument: cutometer\n{steps}\n")
    asked = ["fit", "plan", str(fitted), "-p", "G", "--protocol", str(protocol), "--json"]
    assert app.run(asked) == app.DONE, capsys.readouterr().err
    (row,) = json.loads(capsys.readouterr().out)["candidates"]
    assert row["trouble"] == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--levels", "-1"], "--levels '-1': expected positive numbers"),
        (["--protocol", "demo-aspiration"], "no protocol to choose from for a cutometer"),
        (["--protocol", "nowhere"], "no such file"),
    ],
)
def test_bad_input_is_said_with_status_2(fitted: Path, arguments: list[str], words: str, capsys: Any) -> None:
    assert app.run(["fit", "plan", str(fitted), "-p", "G", *arguments]) == app.BAD_INPUT
    assert words in capsys.readouterr().err


def test_what_is_no_fit_is_refused_by_name(tmp_path: Path, fitted: Path, capsys: Any) -> None:
    for text, words in (("{", "not JSON"), ("[]", "not the result of a fit")):
        (tmp_path / "x.json").write_text(text)
        assert app.run(["fit", "plan", str(tmp_path / "x.json"), "-p", "G"]) == app.BAD_INPUT
        assert words in capsys.readouterr().err
