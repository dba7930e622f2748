"""The sheet as a forward model: path, sensitivities, relaxation, symmetry, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from skinrig_solver import Experiment, Model, SolverError, models
from skinrig_solver.sheet import MODELS
from skinrig_solver.sheet.rays import fold, rays

Array = NDArray[np.float64]
COARSE = {"radial": 3, "around": 8, "points": 4}


def triangles(
    way: tuple[float, ...], reach: float = 1.3e-3, cycles: int = 1, count: int = 41, **geometry: object
) -> Experiment:
    """Triangular cycles of 10 s along ``way``."""
    time = np.linspace(0.0, 10.0 * cycles, count)
    path = reach * (1.0 - np.abs((time / 10.0 % 1.0) * 2.0 - 1.0))
    drive = {f"probe_{axis}": path * x for axis, x in zip("xyz", way, strict=True)}
    return Experiment("microrobot", time, drive, {**COARSE, **geometry}, "triangles")


def channels(experiment: Experiment, name: str = "sheet_ogden", **parameters: float) -> Array:
    result = MODELS[name].simulate(experiment, parameters)
    return np.stack([result.channels[f"force_{axis}"] for axis in "xyz"], axis=1)


def test_registered() -> None:
    assert {name for name in models() if name.startswith("sheet_")} == set(MODELS)
    for name, model in MODELS.items():
        assert isinstance(model, Model)
        assert model.info.name == name
        assert model.info.complete({}) == model.info.defaults


@pytest.mark.parametrize("name", list(MODELS))
@pytest.mark.parametrize("mode", ["load", "initial"])
def test_sensitivities_match_differences(name: str, mode: str) -> None:
    model = MODELS[name]
    frame = "spatial" if name in ("sheet_ogden", "sheet_gasser") else "material"
    experiment = triangles(
        (0.6, 0.5, 0.4), 1e-3, prestress_mode=mode, prestress_ramp=5.0 * (name == "sheet_fung"), frame=frame
    )
    base = {**model.info.defaults, "gbar2": 0.1}
    symbols = model.info.symbols
    result = model.simulate(experiment, base, symbols)
    assert result.parameters == symbols
    assert result.sensitivities is not None
    for k, symbol in enumerate(symbols):
        sides = [
            channels(experiment, name, **{**base, symbol: base[symbol] * (1.0 + 1e-5 * sign)}) for sign in (1.0, -1.0)
        ]
        rate = (sides[0] - sides[1]) / (2e-5 * base[symbol])
        exact = np.stack([result.sensitivities[f"force_{axis}"][:, k] for axis in "xyz"], axis=1)
        force = np.abs(sides[0]).max()
        assert_allclose(exact, rate, atol=1e-4 * np.abs(rate).max() + 1e-7 * force / base[symbol], err_msg=symbol)


def test_sensitivities_hold_off_the_rays() -> None:
    """Tracking error and a little tilt: samples beside the rays, also where a flat membrane would wrinkle."""
    rng = np.random.default_rng(2)
    experiment = triangles((0.8, 0.6, 0.0))
    drive = {axis: path + 1.5e-5 * rng.standard_normal(path.size) for axis, path in experiment.drive.items()}
    wandering = Experiment("microrobot", experiment.time, drive, COARSE)
    result = MODELS["sheet_ogden"].simulate(wandering, {}, ("sx", "alpha2"))
    assert result.sensitivities is not None
    for k, (symbol, value) in enumerate((("sx", 84e3), ("alpha2", 40.09))):
        sides = [channels(wandering, **{symbol: value * (1.0 + 1e-4 * sign)}) for sign in (1.0, -1.0)]
        rate = (sides[0] - sides[1]) / (2e-4 * value)
        for axis in range(3):
            exact = result.sensitivities[f"force_{'xyz'[axis]}"][:, k]
            assert_allclose(exact, rate[:, axis], atol=0.02 * np.abs(rate[:, axis]).max())


def test_sensitivity_subset_keeps_the_order_asked_for() -> None:
    experiment = triangles((1.0, 0.0, 0.0))
    every = MODELS["sheet_yeoh"].simulate(experiment, {}, MODELS["sheet_yeoh"].info.symbols)
    some = MODELS["sheet_yeoh"].simulate(experiment, {}, ("tau", "c10"))
    assert some.sensitivities is not None
    assert every.sensitivities is not None
    column = every.sensitivities["force_x"][:, [every.parameters.index("tau"), every.parameters.index("c10")]]
    assert_allclose(some.sensitivities["force_x"], column)


def test_ray_interpolation_is_converged() -> None:
    coarse = channels(triangles((0.8, 0.6, 0.0), points=7))
    fine = channels(triangles((0.8, 0.6, 0.0), points=14))
    assert_allclose(coarse, fine, atol=1e-3 * np.abs(fine).max())


def test_a_wandering_path_follows_the_sheet_sample_by_sample() -> None:
    """Samples off the rays are continued by the tangent: compare with moving the sheet through every sample."""
    rng = np.random.default_rng(0)
    time = np.linspace(0.0, 10.0, 60)
    path = np.outer(1.2e-3 * np.sin(0.3 * time), [1.0, 0.3, 0.1])
    path += 1.5e-5 * rng.standard_normal(path.shape)
    path[20:30, 1] += 3e-4
    drive = {f"probe_{axis}": path[:, k] for k, axis in enumerate("xyz")}
    elastic = {"gbar": 0.0}
    force = channels(Experiment("microrobot", time, drive, {**COARSE, "points": 7}), "sheet_yeoh", **elastic)
    whole = Experiment("microrobot", time, drive, {**COARSE, "relaxation": "history"})
    exact = channels(whole, "sheet_yeoh", **elastic)
    assert_allclose(force, exact, atol=5e-3 * np.abs(exact).max())


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.5, 0.5, 0.5)])
def test_convolution_against_every_points_stress_history(way: tuple[float, ...]) -> None:
    """In plane they agree to about 1 %; under the normal force the pre-stress relaxes too (docs/validation)."""
    experiment = triangles(way, 1.2e-3)
    history = triangles(way, 1.2e-3, relaxation="history")
    short, full = channels(experiment), channels(history)
    assert_allclose(short[:, 0], full[:, 0], atol=0.02 * np.abs(full[:, 0]).max())
    if way[2]:
        assert_allclose(short[:, 2], full[:, 2], atol=0.15 * np.abs(full[:, 2]).max())


def test_relaxation_dissipates_and_preconditions() -> None:
    experiment = triangles((1.0, 0.0, 0.0), cycles=3, count=301)
    force, x = -channels(experiment)[:, 0], experiment.drive["probe_x"]
    work = [float(np.trapezoid(force[k : k + 101], x[k : k + 101])) for k in (0, 100, 200)]
    stored = float(np.trapezoid(force[200:251], x[200:251]))
    assert work[0] > work[1] > 0.0
    assert work[2] == pytest.approx(work[1], rel=0.02)
    assert 0.05 < work[2] / stored < 0.5
    assert np.abs(channels(experiment, gbar=0.0)[:, 0]).max() > force.max()


@pytest.mark.parametrize("name", ["sheet_ogden", "sheet_gasser"])
def test_forces_share_the_sheets_symmetry(name: str) -> None:
    """Folding a path by symmetry must not change what unfolded directions feel."""
    one = channels(triangles((0.8, 0.5, 0.3)), name)
    assert_allclose(channels(triangles((-0.8, -0.5, 0.3)), name), one * [-1.0, -1.0, 1.0], atol=1e-9)
    assert_allclose(channels(triangles((0.8, 0.5, -0.3)), name), one * [1.0, 1.0, -1.0], atol=1e-9)
    mirrored = channels(triangles((0.8, -0.5, 0.3)), name)
    if name == "sheet_ogden":
        assert_allclose(mirrored, one * [1.0, -1.0, 1.0], atol=1e-9)
    else:
        assert np.abs(mirrored - one * [1.0, -1.0, 1.0]).max() > 1e-2 * np.abs(one).max()


def test_unfolded_mirror_images_agree_on_the_mesh_itself() -> None:
    """The symmetry that folding uses, checked without folding: sample-by-sample runs in mirrored directions."""
    there = channels(triangles((0.8, 0.5, 0.0), count=9, relaxation="history"))
    mirror = channels(triangles((0.8, -0.5, 0.0), count=9, relaxation="history"))
    assert_allclose(mirror, there * [1.0, -1.0, 1.0], atol=1e-8 * np.abs(there).max())


def test_force_opposes_the_probe_and_grows_with_prestress() -> None:
    soft, hard = (channels(triangles((0.6, 0.5, 0.6)), sx=s, sy=s)[20] for s in (40e3, 90e3))
    assert (soft < 0.0).all()
    assert (hard < soft).all()


def test_prestress_mode_changes_the_force_by_several_times() -> None:
    load = channels(triangles((1.0, 0.0, 0.0)))
    initial = channels(triangles((1.0, 0.0, 0.0), prestress_mode="initial"))
    assert 4.0 < np.abs(load).max() / np.abs(initial).max() < 10.0


def test_rays_cover_a_star_of_directions_once() -> None:
    angle = np.radians(np.arange(0, 360, 30))
    star = np.concatenate([np.outer(np.linspace(0.0, 1e-3, 9), [np.cos(a), np.sin(a), 0.0]) for a in angle])
    folded, signs = fold(star, aligned=True)
    assert_allclose(folded * signs, star)
    cover = list(rays(folded))
    assert len(cover) == 4  # 0, 30, 60 and 90 degrees
    assert sorted(np.concatenate([ray.samples for ray in cover])) == list(range(len(star)))
    skew, _ = fold(star, aligned=False)
    assert len(list(rays(skew))) == 6


def test_ray_weights_reproduce_polynomials() -> None:
    ray = next(rays(np.outer(np.linspace(0.0, 2e-3, 30), [0.6, 0.0, 0.8])))
    points = ray.points(5)
    at = np.array([0.0, 3e-4, points[2], 2e-3])
    weights = ray.weights(np.outer(at, [0.6, 0.0, 0.8]), 5)
    assert_allclose(weights @ points**4, at**4, atol=1e-24)


def test_a_probe_at_rest_feels_nothing() -> None:
    time = np.linspace(0.0, 1.0, 5)
    force = channels(Experiment("microrobot", time, {"probe_x": np.zeros(5)}, COARSE))
    assert_allclose(force, 0.0)


def test_result_carries_cost_and_picture() -> None:
    result = MODELS["sheet_ogden"].simulate(triangles((1.0, 0.0, 0.0)), {})
    assert result.cost.newton_steps > 0
    assert result.cost.dofs == 3 * len(result.fields[0].nodes)
    assert result.fields[0].displacement.max() == pytest.approx(1.3e-3)
    assert result.fields[0].cells.max() < len(result.fields[0].nodes)


@pytest.mark.parametrize(
    ("drive", "geometry", "parameters", "message"),
    [
        ({"pressure": 0.0}, {}, {}, "drive 'pressure'"),
        ({}, {}, {}, "no drive"),
        ({"probe_x": 0.0}, {"hole": 1.0}, {}, "'hole'"),
        ({"probe_x": 0.0}, {"hole_radius": 1e-3}, {}, "probe_radius"),
        ({"probe_x": 0.0}, {"hole_radius": "wide"}, {}, "hole_radius"),
        ({"probe_x": 0.0}, {"thickness": -1.0}, {}, "thickness"),
        ({"probe_x": 0.0}, {"prestress_mode": "magic"}, {}, "prestress_mode"),
        ({"probe_x": 0.0}, {"prestress_ramp": -1.0}, {}, "prestress_ramp"),
        ({"probe_x": 0.0}, {"around": 10}, {}, "around"),
        ({"probe_x": 0.0}, {"points": 2}, {}, "points"),
        ({"probe_x": 0.0}, {}, {"stiffness": 1.0}, "stiffness"),
        ({"probe_x": 0.0}, {}, {"mu1": -1.0}, "mu1"),
        ({"probe_x": 0.0}, {}, {"gbar": 0.6, "gbar2": 0.6}, "relaxation"),
    ],
)
def test_wrong_input_is_named(
    drive: dict[str, float], geometry: dict[str, object], parameters: dict[str, float], message: str
) -> None:
    time = np.linspace(0.0, 1.0, 3)
    experiment = Experiment("microrobot", time, {k: np.full(3, v) for k, v in drive.items()}, geometry)
    with pytest.raises(ValueError, match=message):
        MODELS["sheet_ogden"].simulate(experiment, parameters)


@pytest.mark.parametrize("reach", [18e-3, 25e-3])
def test_a_probe_driven_to_the_hole_is_refused(reach: float) -> None:
    with pytest.raises(ValueError, match=r"to or beyond the edge of the hole: there are 18 mm of free skin"):
        channels(triangles((1.0, 0.0, 0.0), reach))


def test_a_prestress_that_skin_would_not_survive_is_warned_of() -> None:
    torn = MODELS["sheet_ogden"].simulate(triangles((1.0, 0.0, 0.0)), {"sx": 1e6, "sy": 1e6})
    assert len(torn.warnings) == 2
    assert "stretches the sheet to 2.43 times its length along x; skin tears near 1.54" in torn.warnings[0]
    assert MODELS["sheet_ogden"].simulate(triangles((1.0, 0.0, 0.0)), {}).warnings == ()


def test_other_instruments_and_unsupported_sensitivities_are_refused() -> None:
    time = np.linspace(0.0, 1.0, 3)
    with pytest.raises(ValueError, match="cutometer"):
        MODELS["sheet_ogden"].simulate(Experiment("cutometer", time, {"pressure": np.zeros(3)}), {})
    for geometry in ({"element": "solid"}, {"relaxation": "history"}):
        with pytest.raises(ValueError, match="sensitivities"):
            MODELS["sheet_ogden"].simulate(triangles((1.0, 0.0, 0.0), **geometry), {}, ["mu1"])
    with pytest.raises(KeyError, match="stiffness"):
        MODELS["sheet_ogden"].simulate(triangles((1.0, 0.0, 0.0)), {}, ["stiffness"])


def test_parameters_without_a_law_are_named() -> None:
    with pytest.raises(SolverError, match=r"bischoff law has no stress at rest: a\^2"):
        MODELS["sheet_bischoff"].simulate(triangles((1.0, 0.0, 0.0)), {"a": 0.5, "b": 0.8, "c": 0.9})


def test_a_sheet_that_cannot_follow_says_when_where_and_under_what() -> None:
    """Chains as dense as paper M prints them are locked by the pre-stress (docs/validation)."""
    with pytest.raises(SolverError, match="no equilibrium") as caught:
        MODELS["sheet_bischoff"].simulate(triangles((1.0, 0.0, 0.0)), {"n": 6.632e20})
    assert caught.value.time == pytest.approx(5.0)
    assert 0.0 < caught.value.load["probe_x"] < 1.3e-3
    assert caught.value.element is not None
