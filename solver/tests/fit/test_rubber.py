"""Published rubber data refitted: at least as good as published parameter sets on the same data."""

from __future__ import annotations

import pytest
import rubber


@pytest.mark.parametrize("material", ["Treloar_1944", "Kawabata_1981", "Meunier_2008"])
def test_ogden_describes_three_tests_at_once(material: str) -> None:
    optimum = rubber.refit(rubber.OGDEN, material)
    parameters = rubber.values(rubber.OGDEN, optimum)
    found = [rubber.misfit(rubber.OGDEN, parameters, material, mode) for mode in rubber.MODES]
    assert max(m.rms for m in found) < 0.03
    assert min(m.determination for m in found) > 0.99


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


@pytest.mark.parametrize("material", ["Treloar_1944", "Kawabata_1981", "Meunier_2008"])
def test_yeoh_describes_tension_and_shear_but_not_what_needs_the_second_invariant(material: str) -> None:
    alone = rubber.values(rubber.YEOH, rubber.refit(rubber.YEOH, material, ("UT",)))
    assert rubber.misfit(rubber.YEOH, alone, material, "UT").rms < 0.04
    together = rubber.values(rubber.YEOH, rubber.refit(rubber.YEOH, material))
    found = {mode: rubber.misfit(rubber.YEOH, together, material, mode) for mode in rubber.MODES}
    assert max(found[mode].rms for mode in ("UT", "PS")) < 0.04
    assert found["ET"].rms < 0.08
    assert rubber.misfit(rubber.YEOH, alone, material, "ET").rms > found["ET"].rms
