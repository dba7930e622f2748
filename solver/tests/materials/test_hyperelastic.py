"""Laws by their energy against closed forms, and against each other where they must agree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from skinrig_solver import Experiment, Model, models
from skinrig_solver.law import Law
from skinrig_solver.materials.hyperelastic import dispersed_fibres, hyperelastic, mooney_rivlin, neo_hooke
from skinrig_solver.materials.yeoh_qlv import yeoh_qlv

Array = NDArray[np.float64]
NEO = hyperelastic("neo_hooke", ("G",), neo_hooke, lambda p: p["G"], 2)
MOONEY = hyperelastic("mooney_rivlin", ("c10", "c01"), mooney_rivlin, lambda p: 2.0 * (p["c10"] + p["c01"]), 2)
FIBRES = hyperelastic("dispersed_fibres", ("G", "k1", "k2", "h"), dispersed_fibres, lambda p: p["G"], 2)
PRONY = {"nu": 0.49, "g1": 0.2, "tau1": 0.3, "g2": 0.1, "tau2": 3.0}
SHAPES = {
    "uniaxial": lambda x: np.diag([x**-0.5, x, x**-0.5]),
    "biaxial": lambda x: np.diag([x, x**-2.0, x]),
    "simple shear": lambda x: np.array([[1.0, x - 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
}
EACH = pytest.mark.parametrize("shape", SHAPES)


def kirchhoff(law: Law, values: dict[str, float], F: Array, times: tuple[float, ...] = (1e-12,)) -> Array:
    """Kirchhoff stress after steps of constant F, without the constraint pressure."""
    code, par = law.kernels(), np.array([values[name] for name in law.parameters])
    state = np.array([list(law.rest.values())], dtype=float)
    kin, out = np.array([[F[0, 0], F[0, 1], F[1, 0], F[1, 1], F[2, 2], 1.0]]), np.zeros((1, 6))
    for dt in times:
        new = np.zeros_like(state)
        code.stress(0, 1, kin, state, par, dt, np.full((1, code.ROOTS), np.nan), out, new)
        state = new
    P = np.array([[out[0, 0], out[0, 1], 0.0], [out[0, 2], out[0, 3], 0.0], [0.0, 0.0, out[0, 4]]])
    return P @ F.T


def deviator(a: Array) -> Array:
    return a - np.eye(3) * np.trace(a) / 3.0


@EACH
@pytest.mark.parametrize("stretch", [0.8, 1.3])
def test_neo_hooke_is_the_closed_form(shape: str, stretch: float) -> None:
    """dev τ = G dev B."""
    F = SHAPES[shape](stretch)
    tau = kirchhoff(NEO, {"G": 3e4, **PRONY}, F)
    assert np.allclose(deviator(tau), 3e4 * deviator(F @ F.T), rtol=1e-9, atol=1e-6)


@EACH
@pytest.mark.parametrize("stretch", [0.8, 1.3])
def test_mooney_rivlin_is_the_closed_form(shape: str, stretch: float) -> None:
    """dev τ = 2 c10 dev B − 2 c01 dev B⁻¹ for isochoric F."""
    F = SHAPES[shape](stretch)
    B = F @ F.T
    tau = kirchhoff(MOONEY, {"c10": 1.2e4, "c01": 3e3, **PRONY}, F)
    assert np.allclose(deviator(tau), 2.4e4 * deviator(B) - 6e3 * deviator(np.linalg.inv(B)), rtol=1e-9, atol=1e-6)


def test_fibres_in_the_plane_resist_biaxial_stretch_and_not_its_reverse() -> None:
    """Equibiaxial stretch x of fibres all in the plane: E = x² − 1 and Ŵ' adds k1 E exp(k2 E²) x² to τ_rr."""
    values = {"G": 1.5e4, "k1": 2e4, "k2": 1.5, "h": 0.5, **PRONY}
    for x in (0.9, 1.2):
        F = SHAPES["biaxial"](x)
        tau = kirchhoff(FIBRES, values, F)
        E = x * x - 1.0
        fibres = values["k1"] * E * np.exp(values["k2"] * E * E) * x * x if E > 0.0 else 0.0
        exact = values["G"] * (x * x - x**-4.0) + fibres  # τ_rr − τ_zz
        assert tau[0, 0] - tau[1, 1] == pytest.approx(exact, rel=1e-9)
    alike = {**values, "h": 1.0 / 3.0}
    F = SHAPES["uniaxial"](1.2)
    E = (np.trace(F @ F.T) - 3.0) / 3.0
    slope = 1.5e4 + 2.0 / 3.0 * 2e4 * E * np.exp(1.5 * E * E)
    assert np.allclose(deviator(kirchhoff(FIBRES, alike, F)), slope * deviator(F @ F.T), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("terms", [0, 1, 4])
def test_any_number_of_prony_terms_relaxes_as_their_sum(terms: int) -> None:
    law = hyperelastic("neo_hooke", ("G",), neo_hooke, lambda p: p["G"], terms)
    shares, times = [0.1, 0.2, 0.05, 0.15][:terms], [0.1, 1.0, 10.0, 100.0][:terms]
    values = {"G": 3e4, "nu": 0.49}
    for i, (g, tau) in enumerate(zip(shares, times, strict=True), 1):
        values |= {f"g{i}": g, f"tau{i}": tau}
    F = SHAPES["simple shear"](1.2)
    first, late = kirchhoff(law, values, F), kirchhoff(law, values, F, (1e-12, 2.0))
    factor = 1.0 - sum(g * (1.0 - np.exp(-2.0 / tau)) for g, tau in zip(shares, times, strict=True))
    assert np.allclose(late, factor * first, rtol=1e-9)
    too_much = np.array([3e4, 0.49, *[0.6, 1.0] * terms])
    assert ("must stay below 1" in law.domain(too_much)) == (terms > 1)


def test_yeoh_by_its_energy_is_yeoh_by_hand() -> None:
    def energy(C, p):  # type: ignore[no-untyped-def]
        x = C.trace() - 3.0
        return 0.5 * p["G"] * x + p["c20"] * x * x

    law = hyperelastic("yeoh_by_energy", ("G", "c20"), energy, lambda p: p["G"], 1)
    values = {"G": 2e4, "c20": 1e4, "nu": 0.49, "g1": 0.2, "tau1": 0.3}
    higher = dict.fromkeys(("c30", "c40", "c50"), 0.0)
    F = np.array([[1.1, 0.2, 0.0], [0.1, 0.95, 0.0], [0.0, 0.0, 1.05]])
    mine, hand = (kirchhoff(k, values | higher, F, (1e-12, 0.2)) for k in (law, yeoh_qlv(1)))
    assert np.allclose(mine, hand, rtol=1e-10)


@pytest.mark.parametrize("name", ["suction_fibres", "suction_yeoh_2"])
def test_catalogue_models_run_and_differentiate(name: str) -> None:
    model: Model = models()[name]
    time = np.linspace(0.0, 2.0, 21)
    run = Experiment("cutometer", time, {"pressure": np.where(time > 0.0, -15e3, 0.0)}, {"mesh": 0.6, "steps": 0.7})
    symbol = model.info.symbols[0]
    result = model.simulate(run, {}, [symbol])
    assert np.all(np.diff(result.channels["apex_height"][1:]) > 0.0)  # it creeps
    value = model.info[symbol].default
    up, down = (model.simulate(run, {symbol: value * f}).channels["apex_height"][-1] for f in (1.002, 0.998))
    assert result.sensitivities is not None
    assert result.sensitivities["apex_height"][-1, 0] == pytest.approx((up - down) / (0.004 * value), rel=2e-3)


def test_layers_of_one_material_are_one_layer() -> None:
    time = np.linspace(0.0, 1.0, 11)
    layers = {"skin": 1.5e-3, "fat": 1.5e-3}
    run = Experiment("cutometer", time, {"pressure": np.where(time > 0.0, -15e3, 0.0)}, {"layers": layers})
    same = {"G": 2e4, "c20": 1e4, "g1": 0.15, "tau1": 0.5, "nu": 0.49}
    stacked = models()["suction_yeoh_2"].simulate(run, {f"{k}.{n}": v for k in layers for n, v in same.items()})
    alone = Experiment("cutometer", time, run.drive, {"layers": {"tissue": 3e-3}})
    one = models()["suction_yeoh_qlv"].simulate(alone, same | {"g2": 0.0, "g3": 0.0})
    assert stacked.channels["apex_height"] == pytest.approx(one.channels["apex_height"], rel=5e-3, abs=1e-8)
