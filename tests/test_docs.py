"""The documentation: what it links to is there, and the commands it names exist."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import COMMANDS, GROUPS
from drivers.microrobot.forces import matrix

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


def test_the_list_of_effects_is_that_of_the_library() -> None:
    made = runpy.run_path(str(ROOT / "tools/effect_list.py"))["page"]()
    assert (ROOT / "docs/effect-list.md").read_text(encoding="utf-8") == made, "run tools/effect_list.py"


def test_the_force_matrix_of_bundles_is_the_drivers() -> None:
    text = (ROOT / "docs/recordings.md").read_text(encoding="utf-8")
    rows = re.search(r"rows of M\n\n```\n(.*?)```", text, flags=re.DOTALL)
    assert rows is not None
    assert np.array([line.split() for line in rows[1].splitlines()], dtype=float) == pytest.approx(matrix(), abs=1e-4)
