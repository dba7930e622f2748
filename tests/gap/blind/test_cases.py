"""Blind cases: repeatable, anonymous, valid bundles, with a key that cannot be read by accident."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import gap.blind
from gap.blind import Truth, make, robot_tissue, tissue
from gap.blind.cases import DELTA, TIERS
from gap.blind.laboratory import STYLES
from gap.blind.lock import seal, unseal
from gap.blind.vocabulary import CONCEPTS, INSTRUMENTS, UNKNOWN, stage_of

pytestmark = pytest.mark.slow


def read_key(path: Path, passphrase: str = "") -> list[Truth]:
    return [Truth(**t) for t in json.loads(unseal(path.read_bytes(), passphrase))["cases"]]


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> dict[str, tuple[Path, list[Truth]]]:
    """Three cases of every tier, one on each instrument."""
    folder = tmp_path_factory.mktemp("blind")
    sets = {}
    for tier in TIERS:
        key = make(tier, 3, 7, folder / tier)
        sets[tier] = (folder / tier, read_key(key))
    return sets


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_equal_arguments_give_equal_cases(tmp_path: Path):
    keys = [make("T4", 1, 3, tmp_path / name, ["cutometer"], style="dense") for name in ("a", "b")]
    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert read_key(keys[0]) == read_key(keys[1])
    make("T4", 1, 4, tmp_path / "c", ["cutometer"], style="dense")
    assert files(tmp_path / "a") != files(tmp_path / "c")
    make("T4", 1, 3, tmp_path / "d", ["cutometer"])
    assert files(tmp_path / "a") != files(tmp_path / "d")


@pytest.mark.parametrize("tier", TIERS)
def test_the_key_tells_what_the_tier_promises(made, tier: str):
    _, truths = made[tier]
    assert {t.instrument for t in truths} == set(INSTRUMENTS)
    for t in truths:
        assert t.tier == tier
        strange = t.law != "conventional"
        assert strange == (tier in ("T3", "T6"))
        assert t.law in (robot_tissue.LAWS if t.instrument == "microrobot" else tissue.LAWS)
        counts = {"T4": (2, 3), "T5": (1,), "T6": (0,)}.get(tier, (0, 1))
        assert len(t.effects) in counts
        for raw in t.effects:
            concept, stage, delta = raw["concept"], raw["stage"], raw["delta"]
            assert delta >= 0
            if tier == "T5":
                assert concept.startswith(UNKNOWN)
                assert stage == UNKNOWN
            else:
                assert stage == stage_of(concept)
                assert t.instrument in CONCEPTS[concept].instruments
        if not t.effects:
            assert t.delta == 0


def test_detectabilities_are_in_the_promised_range(made):
    deltas = [t.delta for tier in ("T1", "T2", "T3", "T5") for t in made[tier][1] if t.effects]
    inside = [DELTA[0] / 1.7 < d < DELTA[1] * 1.7 for d in deltas]
    assert np.mean(inside) > 0.5  # the rest: effects that are or are not, or cannot be seen


def test_names_metadata_and_files_say_nothing(made):
    for tier, (folder, truths) in made.items():
        assert sorted(p.name for p in folder.iterdir()) == sorted([t.case for t in truths] + ["manifest.json"])
        content = b"\n".join(k.encode() + v for k, v in files(folder).items()).lower()
        words = set(CONCEPTS) | {f"{UNKNOWN}_", "conventional", "delta", "effect", "seed", "tier", tier.lower()}
        words |= set(tissue.LAWS) | set(robot_tissue.LAWS) | {h["form"] for t in truths for h in t.effects}
        words |= set(STYLES)
        # Hexadecimal names may hold "t1" by chance, so names are taken out first.
        for t in truths:
            content = content.replace(t.case.encode(), b"")
        leaked = [w for w in words if w.lower().encode() in content]
        assert not leaked, leaked


def test_files_are_written_in_the_order_of_their_names(made):
    for folder, truths in made.values():
        times = [(folder / t.case).stat().st_mtime_ns for t in truths]
        assert [t.case for t in truths] == sorted(t.case for t in truths)
        assert times == sorted(times)


@pytest.mark.parametrize("tier", ["T2", "T6"])
def test_recordings_are_valid_bundles(made, tier: str):
    folder, truths = made[tier]
    for t in truths:
        recordings = sorted((folder / t.case).iterdir())
        assert [p.name for p in recordings] == [f"r{k + 1:02d}" for k in range(len(recordings))]
        last, specimens, repeats = -1.0, set(), []
        for r in recordings:
            meta = yaml.safe_load((r / "recording.yaml").read_text())
            assert meta["schema"] == "recording-bundle/1"
            assert meta["instrument"] == t.instrument
            specimens.add(meta["specimen"])
            repeats.append(meta["repeat"])
            tables = {f: np.genfromtxt(r / f, delimiter=",", names=True) for f in ("data.csv", "command.csv")}
            for group in ("channels", "setpoints"):
                for channel, c in meta[group].items():
                    table = tables[c["file"]]
                    assert np.all(np.isfinite(table[c["column"]])), channel
                    assert np.all(np.diff(table[c["time"]["column"]]) > 0)
            time = tables["data.csv"]["t"]
            assert time[0] > last
            last = time[-1]
            if t.instrument != "microrobot":
                assert tables["command.csv"]["p"].min() < -50  # suction is negative
        assert specimens - {"skin"} == (
            set() if not t.reference else {"open air"} if t.instrument == "microrobot" else {"rigid block"}
        )
        assert max(repeats) >= 2


def test_bundles_import_as_recordings(made):
    bundle = pytest.importorskip("acquire.recording.bundle")
    folder, truths = made["T1"]
    for t in truths:
        recording = bundle.read_bundle(folder / t.case / "r01")
        assert recording.info.instrument == t.instrument


def test_bad_requests_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="T0 is made by the diagnosis"):
        make("T0", 1, 1, tmp_path / "x")
    with pytest.raises(ValueError, match="unknown tier 'T9'"):
        make("T9", 1, 1, tmp_path / "x")
    with pytest.raises(ValueError, match="unknown instrument 'cutometre'"):
        make("T1", 1, 1, tmp_path / "x", ["cutometre"])
    with pytest.raises(ValueError, match="unknown style 'loose'"):
        make("T1", 1, 1, tmp_path / "x", style="loose")
    with pytest.raises(ValueError, match="at least one case"):
        make("T1", 0, 1, tmp_path / "x")
    assert not (tmp_path / "x").exists()
    (tmp_path / "y").mkdir()
    with pytest.raises(FileExistsError):
        make("T6", 1, 1, tmp_path / "y")


@settings(max_examples=15, deadline=None)
@given(st.binary(max_size=300), st.text(max_size=20))
def test_key_round_trip(data: bytes, passphrase: str):
    blob = seal(data, passphrase)
    assert unseal(blob, passphrase) == data
    sealed = blob.partition(b"\n")[2]  # behind the line that says what it is
    assert len(data) < 8 or data not in sealed
    with pytest.raises(ValueError, match="wrong passphrase"):
        unseal(blob, passphrase + "x")
    with pytest.raises(ValueError, match="damaged"):
        unseal(blob[:-40] + bytes([blob[-40] ^ 1]) + blob[-39:], passphrase)


def test_other_files_are_no_keys():
    with pytest.raises(ValueError, match="not a key file"):
        unseal(b"hello", "")


def test_the_generator_imports_nothing_of_the_diagnosis():
    allowed = {"numpy", "scipy", "numba", "yaml", "pydantic"}
    for file in Path(gap.blind.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 1 or (node.level == 0 and _known(node.module or "", allowed)), (file, node.module)
            elif isinstance(node, ast.Import):
                assert all(_known(a.name, allowed) for a in node.names), file


def _known(module: str, allowed: set[str]) -> bool:
    top = module.split(".")[0]
    return top in allowed or top in sys.stdlib_module_names
