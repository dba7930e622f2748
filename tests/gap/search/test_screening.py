"""The screening: its points, and the gains it sees through several widths of the nuisance's prior."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import Candidate
from gap.inference.least_squares import fit, under
from gap.search.compare import Effort, compare
from gap.search.screening import _beginnings, as_if_known, screen
from gap.search.starts import BESIDE, NAMED, RESTS, grid, starting_points
from sim_devices.chain import Parameter

T = np.linspace(0.0, 1.0, 400)


def test_the_grid_surrounds_a_value_that_does_nothing(candidate) -> None:
    signed = candidate("a", Parameter("a", "1", -2.0, 2.0))
    values = [signed.values(u)["a"] for u in grid(signed)]
    assert min(values) < 0 < max(values)
    assert min(abs(v) for v in values) < 0.05


def test_the_screening_looks_at_the_plain_form_of_a_law() -> None:
    """A shape that is nought by default is nought in the plain law; presliding is looked at where a fit leads on."""
    strength = Parameter("force", "N", 1e-3, 5.0, 0.0, 0.4, "log")
    beside = Parameter("presliding", "m", 0.0, 6e-5, None, 0.0, "linear")
    points = grid(Candidate("c", "coulomb_friction", "actuator", (strength, beside), ()))
    assert {float(u[1]) for u in points} == set(NAMED["presliding"])
    other = replace(beside, name="curvature")
    points = grid(Candidate("c", "coulomb_friction", "actuator", (strength, other), ()))
    assert {float(u[1]) for u in points} == {0.0, *BESIDE}
    assert len(points) == 9


def test_the_screening_looks_at_an_exchange_that_is_whole() -> None:
    share = Parameter("share", "1", 0.01, 1.0, 0.0, 1.0, "log")
    swap = Candidate("swap", "axis_swap", "processing", (share,), ())
    assert max(swap.values(u)["share"] for u in grid(swap)) == 1.0


def test_the_screening_looks_at_rests_of_every_length() -> None:
    """Where those of 7 s at least are zeroed after, no fit leads there from points at 1 s and 30 s."""
    effect = library("aspiration")["wrong_zeroing[form=1]"]
    rests = [float(u[0]) for u in grid(Candidate("z", effect.name, effect.stage, effect.parameters, ()))]
    assert tuple(rests) == RESTS
    seconds = [effect.parameters[0].low * 600.0**u for u in rests]
    assert all(later / earlier < 1.5 for earlier, later in pairwise(seconds))
    assert seconds[0] < 0.5
    assert seconds[-1] > 20.0


def test_what_a_wide_prior_swallows_is_seen_through_a_narrow_one(linear, candidate) -> None:
    wave = np.sin(9 * T)
    design = np.column_stack([np.ones_like(T), wave + 0.02 * T])  # nuisance that nearly imitates the effect
    y = 3 * wave + np.random.default_rng(1).normal(size=len(T))
    wide, narrow = np.array([10.0, 10.0]), np.array([10.0, 0.01])
    problem = linear(y, design, {"wave": lambda v: v["a"] * wave, "none": lambda v: v["a"] * np.cos(40 * T)}, wide)
    problem.prior_scales = (wide, narrow)
    known = [candidate(n, Parameter("a", "1", -30.0, 30.0)) for n in ("wave", "none")]
    base = Hypothesis((), {"linear": fit(problem)})
    found, _ = screen({"linear": problem}, base, known)
    first = found[0]
    assert first.candidate.name == "wave"
    assert first.gain > 1.0
    assert first.widths["linear"] is narrow


def test_a_law_that_does_not_hold_makes_no_effect_hopeful(linear, candidate) -> None:
    """Under a simple law far from the data any effect explains much of it: the robot's were told by it which of them to
    fit."""
    y = 50.0 * T + np.random.default_rng(7).normal(size=len(T))
    design = np.column_stack([np.ones(len(T)), T])
    problem = linear(y, design, {"bow": lambda v: v["a"] * np.sqrt(T)}, np.array([100.0, 100.0]))
    problem.prior_scales = (np.array([100.0, 100.0]), np.array([100.0, 0.01]))
    bow = candidate("bow", Parameter("a", "1", -30.0, 30.0, 0.0))
    found, _ = screen({"linear": problem}, Hypothesis((), {"linear": fit(problem)}), [bow])
    assert found[0].score < 10.0


def test_a_limit_that_all_usual_strengths_are_far_below_is_looked_for_where_it_is_met(linear, candidate) -> None:
    """The signal goes to 1: at a limit of 0.75 and less it is cut by hundreds of σ, of 1.5 it does nothing."""
    signal = 1e4 * T

    def cut(values):
        return np.minimum(signal, 1e4 * values["limit"]) - signal

    y = cut({"limit": 0.995}) + np.random.default_rng(4).normal(size=len(T))
    problem = linear(y, np.ones((len(T), 1)), {"cut": cut})
    limit = candidate("cut", Parameter("limit", "1", 0.05, 1.5, 10.0, 0.4, "log"))
    found, _ = screen({"linear": problem}, Hypothesis((), {"linear": fit(problem)}), [limit])
    assert found[0].gain > 20.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_strength_of_either_sign_is_looked_for_where_it_shows(linear, candidate, sign: float) -> None:
    """A pendulum adds up a small drag over all its swings: the least that was tried was millions of σ, and it was told
    creep (32 σ)."""
    problem = linear(
        sign * 10.0 * T + np.random.default_rng(5).normal(size=len(T)),
        np.ones((len(T), 1)),
        {"drag": lambda v: 1e6 * v["coefficient"] * T},
    )
    drag = candidate("drag", Parameter("coefficient", "1", -5.0, 5.0, 0.0, 1.0))
    found, _ = screen({"linear": problem}, Hypothesis((), {"linear": fit(problem)}), [drag])
    assert found[0].gain > 100.0


def test_a_threshold_is_looked_for_where_it_begins_to_show(linear, candidate) -> None:
    """Below 0.3 it does nothing, at 0.8 it is a hundred and fifty σ in each: straight lines are good for neither."""
    late = T > 0.9

    def beyond(v: dict[str, float]) -> np.ndarray:
        return 300.0 * np.maximum(v["a"] - 0.3, 0.0) * late

    problem = linear(4.0 * late + np.random.default_rng(2).normal(size=len(T)), np.ones((len(T), 1)), {"limit": beyond})
    limit = candidate("limit", Parameter("a", "1", 1e-3, 10.0, 0.0, 0.1, "log"))
    base = Hypothesis((), {"linear": fit(problem)})
    found, _ = screen({"linear": problem}, base, [limit])
    assert found[0].gain > 100


def test_a_limit_is_looked_for_where_the_channel_ends(linear, candidate) -> None:
    """A height that was cut off was told a wrong scale: the limits that were tried lay above it."""
    y = np.minimum(np.linspace(0.0, 20.0, 400), 14.0)
    cut = {"sensor_saturation": lambda v: np.zeros(400)}
    saturation = candidate("sensor_saturation", Parameter("limit", "m", 0.1, 1e3, 1e3, 500.0, "log"))
    problem = linear(y, np.ones((400, 1)), cut, np.full(1, 100.0))
    points, _ = starting_points(saturation, {"linear": problem}, Hypothesis((), {"linear": fit(problem)}))
    assert min(saturation.values(point)["limit"] for point in points) == pytest.approx(14.0)


def test_a_knee_is_looked_for_below_the_greatest_value(linear, candidate) -> None:
    """A gauge of two slopes was missed (δ_free 170): half of the knee's range was above all pressures."""
    y = np.linspace(0.0, 20.0, 400)
    bend = {"bend": lambda v: v["error"] * np.maximum(y - v["knee"], 0.0)}
    bent = candidate("bend", Parameter("error", "1", -0.4, 0.4, 0.0), Parameter("knee", "1", 2.0, 100.0))
    problem = linear(y + bend["bend"]({"error": 0.2, "knee": 9.0}), np.ones((400, 1)), bend, np.full(1, 100.0))
    points, _ = starting_points(bent, {"linear": problem}, Hypothesis((), {"linear": fit(problem)}))
    knees = {round(bent.values(point)["knee"], 1) for point in points}
    assert sum(k < 20.0 for k in knees) >= 2


def test_a_flaw_is_looked_for_where_the_signal_is(linear, candidate) -> None:
    """A scratch at two thirds of the heights (δ_free 75) was told a deep layer: its fit ended beyond all of them."""
    y = np.linspace(0.0, 20.0, 400)
    flaw = {"flaw": lambda v: v["error"] * np.exp(-(((y - v["at"]) / 2.0) ** 2))}
    scratched = candidate("flaw", Parameter("error", "1", -9.0, 9.0, 0.0), Parameter("at", "1", 2.0, 100.0))
    problem = linear(y + flaw["flaw"]({"error": 2.0, "at": 13.0}), np.ones((400, 1)), flaw, np.full(1, 100.0))
    points, _ = starting_points(scratched, {"linear": problem}, Hypothesis((), {"linear": fit(problem)}))
    places = {round(scratched.values(point)["at"], 1) for point in points}
    assert len(places) >= 3
    assert max(places) < 20.0


def test_a_jump_and_one_recording_are_tried_where_they_can_be(linear, candidate) -> None:
    y = 3.0 * (np.arange(len(T)) >= 260) + np.random.default_rng(3).normal(size=len(T))
    problem = linear(y, np.ones((len(T), 1)), {"jump": lambda v: v["a"] * (np.arange(len(T)) >= v["moment"])}, runs=2)
    moment = Parameter("moment", "s", 1.0, 400.0, None, 1.0, "log")
    base = Hypothesis((), {"linear": fit(problem)})
    found, _ = screen({"linear": problem}, base, [candidate("jump", Parameter("a", "1", -9.0, 9.0), moment)])
    jump = found[0]
    assert jump.candidate.values(jump.starts["linear"][0])["moment"] == pytest.approx(260, abs=2)


def test_who_could_do_what_the_best_does_is_refitted_wherever_it_ranks(linear, candidate) -> None:
    """Along straight lines from where it begins, the bent one seems to make all worse."""
    t = np.linspace(0.0, 1.0, 300)
    y = 6.0 * t**2 + np.random.default_rng(0).normal(size=300)
    effects = {
        "square": lambda v: v["a"] * t**2,
        "bent": lambda v: v["a"] * t**2.2,
        "wave": lambda v: v["a"] * np.sin(40 * t),
    }
    problem = linear(y, np.ones((300, 1)), effects, np.full(1, 100.0))
    known = [
        candidate("square", Parameter("a", "1", -10.0, 10.0, null=0.0)),
        candidate("bent", Parameter("a", "1", 30.0, 300.0, null=0.0)),
        candidate("wave", Parameter("a", "1", -10.0, 10.0, null=0.0)),
    ]
    for imitators, tried in ((0, {"square"}), (1, {"square", "bent"})):
        found = compare([problem], known, Effort(quick_fits=0, refit_singles=1, imitators=imitators, pair_bases=0))
        assert {h.name for h in found.hypotheses} == tried


def test_what_a_wide_prior_swallows_is_tried_under_a_simple_law(linear, candidate) -> None:
    """The wide prior's own columns do all that the effect does: beside it nothing is left to see."""
    wave = np.sin(9 * T)
    y = 3 * wave + np.random.default_rng(1).normal(size=len(T))
    effects = {"wave": lambda v: v["a"] * wave, "none": lambda v: v["a"] * np.cos(40 * T)}
    problem = linear(y, np.column_stack([np.ones_like(T), wave]), effects, np.full(2, 10.0))
    simple = under(problem, np.zeros(2), np.array([10.0, 1e-6]))
    problem.open_law, problem.under_simple_law = True, lambda c, unit: fit(simple, (c,), unit, iterations=4)
    known = [candidate(n, Parameter("a", "1", -30.0, 30.0, null=0.0)) for n in ("none", "wave")]
    found, _ = screen({"linear": problem}, Hypothesis((), {"linear": fit(problem)}), known)
    assert max(s.gain for s in found) < 1.0
    chosen, simulations = as_if_known({"linear": problem}, found, 1)
    assert [s.candidate.name for s in chosen] == ["wave"]
    assert chosen[0].candidate.values(chosen[0].starts["linear"][0])["a"] == pytest.approx(3.0, abs=0.3)
    assert simulations > 0
    problem.under_simple_law = lambda c, unit: None  # a simple law is at the noise
    assert as_if_known({"linear": problem}, found, 1) == ([], 0)


def test_who_could_do_what_a_tolerance_took_on_is_refitted_too(linear, candidate) -> None:
    """The best effect then changes no residual, only the penalty of the tolerance."""
    t = np.linspace(0.0, 1.0, 300)
    y = 6.0 * t**2 + np.random.default_rng(0).normal(size=300)
    effects = {
        "square": lambda v: v["a"] * t**2,
        "bent": lambda v: v["a"] * t**2.2,
        "wave": lambda v: v["a"] * np.sin(40 * t),
    }
    problem = linear(y, t[:, None] ** 2, effects, np.full(1, 0.5))
    known = [
        candidate("square", Parameter("a", "1", -10.0, 10.0, null=0.0)),
        candidate("wave", Parameter("a", "1", -10.0, 10.0, null=0.0)),
        candidate("bent", Parameter("a", "1", 30.0, 300.0, null=0.0)),
    ]
    found = compare([problem], known, Effort(quick_fits=0, refit_singles=1, imitators=1, pair_bases=0))
    assert {h.name for h in found.hypotheses} == {"square", "bent"}


def test_a_point_at_which_the_simulation_diverges_says_nothing(linear, candidate) -> None:
    y = 3 * np.sin(9 * T) + np.random.default_rng(1).normal(size=len(T))

    def diverging(v):
        return v["a"] * np.sin(9 * T) if abs(v["a"]) < 2.0 else np.full(len(T), np.nan)

    problem = linear(y, np.ones((len(T), 1)), {"wild": diverging})
    base = Hypothesis((), {"linear": fit(problem)})
    (screened,), _ = screen({"linear": problem}, base, [candidate("wild")])
    assert np.isfinite(screened.gain)
    assert screened.gain > 0
    assert np.all(np.isfinite(screened.traces["linear"]))


def test_a_shape_between_those_that_were_screened_counts_as_alike(linear, candidate) -> None:
    """The nuisance imitates nearly all of a line, so that powers of 0.6 and 1.4 stand apart from it."""
    t = np.linspace(0.01, 1.0, 300)
    y = 6.0 * t + np.random.default_rng(0).normal(size=300)
    effects = {
        "line": lambda v: v["a"] * t,
        "power": lambda v: v["a"] * t ** v["exponent"],
        "wave": lambda v: v["a"] * np.sin(40 * t),
    }
    problem = linear(y, t[:, None], effects, np.full(1, 0.3))
    known = [
        candidate("line", Parameter("a", "1", -10.0, 10.0, null=0.0)),
        candidate("wave", Parameter("a", "1", -10.0, 10.0, null=0.0)),
        candidate("power", Parameter("a", "1", 3.0, 300.0, 0.0, 30.0, "log"), Parameter("exponent", "1", 0.2, 1.8)),
    ]
    found = compare([problem], known, Effort(quick_fits=0, refit_singles=1, imitators=1, pair_bases=0))
    assert {h.name for h in found.hypotheses} == {"line", "power"}


def test_strengths_of_one_effect_are_looked_at_together(linear, candidate) -> None:
    """A matrix of terms: along its first alone, which is nought here, there is nothing to be seen."""
    columns = {f"s{k}": np.cos((3 + 2 * k) * np.pi * T) for k in range(6)}
    true = dict(zip(columns, (0.0, 1.2, -1.0, 0.8, -1.1, 0.9), strict=True))

    def matrix(v: dict[str, float]) -> np.ndarray:
        return sum(v[name] * column for name, column in columns.items())

    y = 0.4 * matrix(true) + np.random.default_rng(5).normal(size=len(T))
    problem = linear(y, np.ones((len(T), 1)), {"matrix": matrix})
    base = Hypothesis((), {"linear": fit(problem)})
    terms = [Parameter(name, "1", -10.0, 10.0) for name in columns]
    found, _ = screen({"linear": problem}, base, [candidate("matrix", *terms)])
    start = found[0].candidate.values(found[0].starts["linear"][0])
    assert found[0].gain > 50
    assert start == pytest.approx({name: 0.4 * value for name, value in true.items()}, abs=0.25)


def test_an_answer_by_steps_is_not_made_larger(linear, candidate) -> None:
    """Another threshold leaves other steps out, and makes none larger: what is half of the true answer at a wrong one
    began a fit that never came to the right one (seed 410004)."""
    command = np.repeat([0.0, 3.0, 7.0, 15.0, 18.0, 30.0, 31.0, 44.0], 50)
    right, half = np.where(command == 18.0, -3.0, 0.0), np.where(command == 18.0, -1.6, 0.0)

    def missed(v: dict[str, float]) -> np.ndarray:
        return 9.0 * (right if 4.0 < v["band"] < 5.0 else half if v["band"] > 5.0 else 0.0 * command)

    y = 9.0 * right + np.random.default_rng(1).normal(size=len(T))
    problem = linear(y, np.ones((len(T), 1)), {"valve": missed})
    valve = candidate("valve", Parameter("band", "1", 0.1, 40.0, 0.0, 1.0, "log"))
    found, _ = screen({"linear": problem}, Hypothesis((), {"linear": fit(problem)}), [valve])
    first = valve.values(found[0].starts["linear"][0])["band"]
    assert 4.0 < first < 5.0


def test_an_event_begins_at_one_moment_in_all_blocks() -> None:
    """A block of references in which it did not happen must not lead its fit elsewhere."""
    units = [np.array([0.1]), np.array([0.8])]
    earned = {"reference": np.array([9.0, 0.0]), "height": np.array([1.0, 50.0])}
    always = Candidate("leak", "leak", "interface", (), ("reference", "height"))
    gain, starts = _beginnings(replace(always, event=True), units, earned)
    assert gain == 50.0
    assert [(b, [float(u[0]) for u in us]) for b, us in starts.items()] == [("height", [0.8]), ("reference", [0.8])]
    gain, starts = _beginnings(always, units, earned)
    assert gain == 59.0
    assert [float(us[0][0]) for us in starts.values()] == [0.1, 0.8]
