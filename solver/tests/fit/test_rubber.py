"""Published rubber data refitted: at least as good as published parameter sets on the same data."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import rubber


@pytest.fixture
def published(public_data) -> Path:
    return public_data("rubber_hyperelastic")


@pytest.fixture
def made_up(tmp_path, monkeypatch) -> dict[str, float]:
    """Tests of one Yeoh rubber in a file of the published form: its parameters [Pa]."""
    truth = {"c10": 0.2e6, "c20": -1e3, "c30": 50.0}
    one = np.linspace(1.05, 4.0, 12)
    with h5py.File(tmp_path / "data.h5", "w") as file:
        for material in rubber.MATERIALS:
            for mode, two in {"UT": one**-0.5, "PS": np.ones(12), "ET": one}.items():
                group = file.create_group(f"{material}/{mode}")
                group.attrs["stress_type"] = "PK1"
                experiment = rubber.Experiment("microrobot", np.arange(12.0), {"stretch_1": one, "stretch_2": two}, {})
                stress = rubber.YEOH.simulate(experiment, truth).channels["stress"] / rubber.MPA
                group["F"] = np.array([np.diag([a, b, 1 / (a * b)]) for a, b in zip(one, two, strict=True)])
                group["stress"] = np.array([np.diag([s, 0.0, 0.0]) for s in stress])
    monkeypatch.setattr(rubber, "tests", lambda: rubber.read(tmp_path / "data.h5"))
    return truth


def test_a_made_up_rubber_gives_its_parameters_back(made_up) -> None:
    assert rubber.values(rubber.YEOH, rubber.refit(rubber.YEOH, "Treloar_1944")) == pytest.approx(made_up, rel=1e-3)
    assert rubber.misfit(rubber.YEOH, made_up, "Meunier_2008", "ET").rms < 1e-9


def test_stress_of_another_kind_is_refused(made_up, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "data.h5", "a") as file:
        file["Treloar_1944/PS"].attrs["stress_type"] = "cauchy"
    with pytest.raises(ValueError, match="stress is cauchy, not PK1"):
        rubber.tests()


@pytest.mark.usefixtures("published")
@pytest.mark.parametrize("material", ["Treloar_1944", "Kawabata_1981", "Meunier_2008"])
def test_ogden_describes_three_tests_at_once(material: str) -> None:
    optimum = rubber.refit(rubber.OGDEN, material)
    parameters = rubber.values(rubber.OGDEN, optimum)
    found = [rubber.misfit(rubber.OGDEN, parameters, material, mode) for mode in rubber.MODES]
    assert max(m.rms for m in found) < 0.03
    assert min(m.determination for m in found) > 0.99


@pytest.mark.usefixtures("published")
def test_treloar_by_ogden_is_closer_than_the_parameters_of_1972() -> None:
    mine = rubber.values(rubber.OGDEN, rubber.refit(rubber.OGDEN, "Treloar_1944"))
    published = {n: v * (1.0 if n.startswith("alpha") else rubber.MPA) for n, v in rubber.OGDEN_1972.items()}
    for mode in rubber.MODES:
        theirs = rubber.misfit(rubber.OGDEN, published, "Treloar_1944", mode)
        assert rubber.misfit(rubber.OGDEN, mine, "Treloar_1944", mode).relative < theirs.relative
        assert theirs.rms < 0.06
    assert mine["alpha1"] == pytest.approx(1.3, abs=0.2)
    assert mine["alpha3"] == pytest.approx(-2.0, abs=0.2)
    modulus = 0.5 * sum(mine[f"mu{i}"] * mine[f"alpha{i}"] for i in (1, 2, 3))
    assert modulus == pytest.approx(0.4 * rubber.MPA, rel=0.05)  # Treloar's own estimate of the shear modulus


@pytest.mark.usefixtures("published")
@pytest.mark.parametrize("material", ["Treloar_1944", "Kawabata_1981", "Meunier_2008"])
def test_yeoh_describes_tension_and_shear_but_not_what_needs_the_second_invariant(material: str) -> None:
    alone = rubber.values(rubber.YEOH, rubber.refit(rubber.YEOH, material, ("UT",)))
    assert rubber.misfit(rubber.YEOH, alone, material, "UT").rms < 0.04
    together = rubber.values(rubber.YEOH, rubber.refit(rubber.YEOH, material))
    found = {mode: rubber.misfit(rubber.YEOH, together, material, mode) for mode in rubber.MODES}
    assert max(found[mode].rms for mode in ("UT", "PS")) < 0.04
    assert found["ET"].rms < 0.08
    assert rubber.misfit(rubber.YEOH, alone, material, "ET").rms > found["ET"].rms
