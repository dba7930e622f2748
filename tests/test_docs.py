"""The documentation: what it links to is there, and the commands it names exist."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import COMMANDS, GROUPS
from drivers.microrobot.forces import matrix
from drivers.microrobot.kinematics import GEOMETRY
from gap.data.tolerances import tolerances
from gap.null.robot_loop import CONTROLLERS
from sim_devices.stages.axes import FORCE_LIMIT, LOOP_RATE, MASS
from sim_devices.stages.suction import COMMAND_STEP, OPENING, REGULATOR_TAU, VACUUM
from sim_devices.stages.tissues import SHEET, SUCTION

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    p for p in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "solver/README.md"] if ".venv" not in p.parts
)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_exist(page: Path) -> None:
    named = re.findall(r"(?:^|`|; )acquire ([a-z]+)", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert set(named) <= set(COMMANDS) | set(GROUPS)


def test_decisions_are_numbered_short_and_indexed() -> None:
    folder = ROOT / "docs/decisions"
    records = sorted(p for p in folder.glob("*.md") if p.name != "README.md")
    assert [int(p.name[:4]) for p in records] == list(range(1, len(records) + 1))
    index = (folder / "README.md").read_text(encoding="utf-8")
    for number, record in enumerate(records, 1):
        lines = record.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= 40, record.name
        assert lines[0].startswith(f"# {number}. "), record.name
        assert f"[{lines[0].lstrip('# ')}]({record.name})" in index, record.name


@pytest.mark.parametrize(
    ("tool", "page"), [("effect_list.py", "effect-list.md"), ("tolerance_list.py", "tolerances.md")]
)
def test_made_pages_are_those_of_the_library(tool: str, page: str) -> None:
    made = runpy.run_path(str(ROOT / "tools" / tool))["page"]()
    assert (ROOT / "docs" / page).read_text(encoding="utf-8") == made, f"run tools/{tool} docs/{page}"


def test_the_nominal_page_has_the_numbers_of_the_code() -> None:
    text = (ROOT / "docs/nominal.md").read_text(encoding="utf-8")
    skin, sheet, regulator = SUCTION["forearm"], SHEET["forearm"], tolerances("cutometer")["regulator"]
    said = [
        f"τ = {1e3 * REGULATOR_TAU:g} ms,  ζ = 1",
        f"rounded to {COMMAND_STEP / 100:g} mbar",
        *(f"0 to −{-pressure / 100:g} mbar" for pressure in VACUUM.values()),
        f"opening** is {1e3 * OPENING['cutometer']:g} mm (Cutometer) and {1e3 * OPENING['aspiration']:g} mm",
        f"C = {1e9 * skin.compliance:g} nm/Pa",
        f"q₀ = {skin.knee / 100:g} mbar, m = {skin.exponent:g}",
        f"τ within {100 * regulator['time'].other:g} % and ζ within {100 * regulator['damping'].other:g} %",
        f"a valve's lag, of {1e3 * regulator['lead'].other:g} ms",
        f"m = {1e3 * MASS:g} g is",
        f"{3 * MASS * LOOP_RATE**2:g} N/m, Ki",
        f"{MASS * LOOP_RATE**3:g} N/(m s), Kd",
        f"{3 * MASS * LOOP_RATE:g} N s/m.",
        f"≤ {FORCE_LIMIT:g} N",
        f"ρ = {1e3 * GEOMETRY.axis_radius:g} mm",
        f"H = {1e3 * GEOMETRY.tip_height:g} mm",
        "{:g}, {:g} and {:g} N/m".format(*sheet.stiffness),
        f"l = {1e3 * sheet.length:g} mm, p = {sheet.exponent:g}",
        *(f"{c.proportional:g} N/m, {c.integral:g} N/(m s), {c.derivative:g} N s/m, {c.drag:g}" for c in CONTROLLERS),
    ]
    assert [words for words in said if words not in text] == []


def test_the_force_matrix_of_bundles_is_the_drivers() -> None:
    text = (ROOT / "docs/recordings.md").read_text(encoding="utf-8")
    rows = re.search(r"rows of M\n\n```\n(.*?)```", text, flags=re.DOTALL)
    assert rows is not None
    assert np.array([line.split() for line in rows[1].splitlines()], dtype=float) == pytest.approx(matrix(), abs=1e-4)
