"""Whether a diagnosis depends on the tissue law: ``python benchmarks/gap_fe.py [--cases 30] [--first 0] [--seed 1]``.

Sessions of the suction instruments are made with one tissue (the reduced law or finite elements) and diagnosed with
both. Printed for every case: the hidden effect, both verdicts, seconds of processor time; then how often the verdict
with the *other* tissue is the one with the tissue that made the data. Needs a solver plug-in.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from acquire.recording.model import Recording, RunInfo, Series
from gap.design.simulated import Leg, suction_legs, suction_session
from gap.diagnosis import Diagnosis, diagnose
from gap.effects.load import library
from gap.null.fe_solver import Experiment, FeModel, fe_model
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages import RATES, noisy, nominal
from sim_devices.stages.sampling import REFINEMENT, simulate
from sim_devices.stages.suction import OPENING, with_tissue
from sim_devices.stages.tissues import for_opening, suction_tissue

MODEL = "suction_yeoh_qlv"
NOTHING = 0.25
"""Share of the cases without any effect."""
NOTHING_CLAIMED = {"none": "nothing", "undetectable": "nothing"}
PAUSE = 20.0
"""s between recordings."""


@dataclass(frozen=True)
class Case:
    """A session, what made it, and the effect hidden in it ('' for none)."""

    instrument: str
    tissue: str
    effect: str
    recordings: Sequence[Recording]


@dataclass(frozen=True)
class Row:
    """The result of a case: whether the two diagnoses agree, whether each is right, seconds of processor time."""

    tissue: str
    verdict: bool
    same: bool
    right_reduced: bool
    right_fe: bool
    seconds_reduced: float
    seconds_fe: float
    solves: int


def hidden(instrument: str, rng: np.random.Generator) -> tuple[str, list[tuple[Effect, Mapping[str, float]]]]:
    """An effect of any stage but the tissue (whose effects another law may well explain), or none."""
    if rng.random() < NOTHING:
        return "", []
    names: dict[str, Effect] = {}
    for effect in library(instrument).values():
        if effect.stage != "tissue":
            names.setdefault(effect.name, effect)
    effect = names[str(rng.choice(sorted(names)))]
    values = {}
    for p in effect.parameters:
        u = float(rng.uniform(0.5, 0.95)) if p.null is not None else float(rng.uniform(0.2, 0.8))
        values[p.name] = p.low * (p.high / p.low) ** u if p.scale == "log" else p.low + u * (p.high - p.low)
    return effect.name, [(effect, values)]


def fe_parameters(instrument: str, rng: np.random.Generator) -> dict[str, float]:
    """Skin of the Yeoh law with relaxation times that the diagnosis does not have."""
    modulus = float(np.exp(rng.normal(0.0, 0.2))) * (6e4 if instrument == "cutometer" else 2.4e4)
    shares = rng.uniform(0.08, 0.2, 3)
    taus = np.array([0.2, 2.0, 25.0]) * np.exp(rng.normal(0.0, 0.4, 3))
    out = {"G": modulus, "c20": modulus * rng.uniform(0.2, 0.7), "c30": modulus * rng.uniform(0.0, 0.1)}
    for i in range(3):
        out |= {f"g{i + 1}": float(shares[i]), f"tau{i + 1}": float(taus[i])}
    return out | {"friction": 0.0, "spring_force": 0.0}


def fe_session(
    instrument: str, rng: np.random.Generator, effects: Sequence[tuple[Effect, Mapping[str, float]]], model: FeModel
) -> list[Recording]:
    """As `gap.design.simulated.suction_session`, the skin by full finite elements under the pressure that
    reaches it."""
    legs = [leg for leg in suction_legs(instrument, rng) if leg.specimen == "skin"]
    starts = np.cumsum([0.0, *[leg.duration + PAUSE for leg in legs]])[:-1]
    stamps = [s + np.arange(0.0, leg.duration, 1 / RATES[instrument]) for s, leg in zip(starts, legs, strict=True)]
    bare = replace(suction_tissue("forearm"), creep=(), times=(), residual=0.0, softening=0.0)
    chain = nominal(instrument, marks=tuple(float(s) for s in starts))
    chain = with_tissue(chain, for_opening(bare, OPENING[instrument]))
    for effect, values in effects:
        chain = effect.apply(chain, values)
    chain = noisy(chain, int(rng.integers(1 << 30)), scatter=0.0)
    table = (
        np.concatenate([s + leg.quantity_tables["pressure"][0] for s, leg in zip(starts, legs, strict=True)]),
        np.concatenate([leg.quantity_tables["pressure"][1] for leg in legs]),
    )
    bulge = _solved(instrument, chain, table, float(stamps[-1][-1]), fe_parameters(instrument, rng), model)
    at = np.concatenate(stamps)
    given = {chain["elastic"].writes[0]: bulge}
    made = simulate(chain, {"pressure": table}, {"pressure": at, "apex_height": at}, given)
    ends = np.cumsum([len(s) for s in stamps])
    return [
        _recording(
            instrument,
            leg,
            {
                "pressure": made["pressure"][end - len(s) : end],
                "apex_height": made["apex_height"][end - len(s) : end] * (1 + 0.03 * rng.standard_normal()),
            },
            s,
            float(start),
        )
        for leg, s, start, end in zip(legs, stamps, starts, ends, strict=True)
    ]


def _solved(
    instrument: str,
    chain: Chain,
    table: tuple[FloatArray, FloatArray],
    end: float,
    parameters: Mapping[str, float],
    model: FeModel,
) -> tuple[FloatArray, FloatArray]:
    """Times and heights of a full solve on the default mesh."""
    fine = np.unique(np.concatenate([np.arange(0.0, end, 0.1), (table[0][:, None] + REFINEMENT).ravel(), [end]]))
    fine = fine[(np.diff(fine, prepend=-1.0) > 1e-6) & (fine <= end)]
    pressure = simulate(chain, {"pressure": table}, {"skin_pressure": fine})["skin_pressure"]
    run = Experiment(instrument, fine, {"pressure": pressure}, {"opening_radius": OPENING[instrument] / 2})
    return fine, model.simulate(run, parameters)[0][0]


def _recording(
    instrument: str, leg: Leg, channels: Mapping[str, FloatArray], time: FloatArray, start: float
) -> Recording:
    units = {"pressure": "Pa", "apex_height": "m"}
    streams = {n: Series(v, time, units[n], seq=np.arange(len(time))) for n, v in channels.items()}
    corners, value = leg.quantity_tables["pressure"]
    begin = (datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=start)).isoformat()
    info = RunInfo(id=f"simulated-{start:.0f}", instrument=instrument, start_time=begin, repeat=leg.repeat)
    return Recording(info, streams, {"pressure": Series(value, corners + start, "Pa")})


def make(number: int, seed: int) -> Case:
    """Case ``number``: instruments in turn, tissues in turn."""
    rng = np.random.default_rng([seed, number])
    instrument = ("cutometer", "aspiration")[number % 2]
    tissue = ("reduced", "finite elements")[number // 2 % 2]
    name, effects = hidden(instrument, rng)
    if tissue == "reduced":
        site = "forearm" if instrument == "cutometer" else str(rng.choice(["face", "forehead", "jaw"]))
        return Case(instrument, tissue, name, suction_session(instrument, rng, effects, suction_tissue(site)))
    return Case(instrument, tissue, name, fe_session(instrument, rng, effects, fe_model(MODEL)))


def said(d: Diagnosis) -> str:
    """The verdict and, where a cause is named, its class."""
    if d.verdict.verdict in ("effect", "several"):
        first = d.verdict.causes[0]
        return f"{d.verdict.verdict}: {' = '.join(first.names)}, δ {first.detectability:.3g}"
    return d.verdict.verdict


def same_class(a: Diagnosis, b: Diagnosis) -> bool:
    """The same answer: nothing claimed by either (``none`` or ``undetectable``), both unknown, or causes whose classes
    share a member."""
    kinds = [NOTHING_CLAIMED.get(d.verdict.verdict, d.verdict.verdict) for d in (a, b)]
    if kinds[0] != kinds[1]:
        return False
    if kinds[0] not in ("effect", "several"):
        return True
    return bool(set(a.verdict.causes[0].names) & set(b.verdict.causes[0].names))


def right(d: Diagnosis, effect: str) -> bool:
    """Whether the verdict is the truth's: the effect's class, or nothing claimed where there was none."""
    if not effect:
        return d.verdict.verdict in ("none", "undetectable")
    return bool(d.verdict.causes) and any(effect in n.split(" + ") for n in d.verdict.causes[0].names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows: list[Row] = []
    for number in range(options.first, options.first + options.cases):
        try:
            case = make(number, options.seed)
        except ValueError as error:
            print(f"{number:3d} not made: {error}", flush=True)
            continue
        results, seconds = [], []
        for solver in ("", MODEL):
            begin = time.process_time()
            results.append(diagnose(case.recordings, solver=solver))
            seconds.append(time.process_time() - begin)
        reduced, fe = results
        verdict, full = reduced.verdict.verdict == fe.verdict.verdict, same_class(reduced, fe)
        truths = right(reduced, case.effect), right(fe, case.effect)
        rows.append(Row(case.tissue, verdict, full, *truths, seconds[0], seconds[1], fe.fe_solves))
        print(
            f"{number:3d} {case.instrument:10s} made with {case.tissue:15s} {case.effect or '-':22s} "
            f"reduced [{said(reduced)}]  finite elements [{said(fe)}]  {'same' if full else 'OTHER'}  "
            f"{seconds[0]:.1f} s, {seconds[1]:.1f} s; {' '.join(w for w in fe.remarks if 'surrogate' in w)}",
            flush=True,
        )
    summarise(rows)


def summarise(rows: Sequence[Row]) -> None:
    """Agreement by the tissue that made the data, and cost."""
    for label, chosen in (
        ("made with reduced, diagnosed with finite elements", [r for r in rows if r.tissue == "reduced"]),
        ("made with finite elements, diagnosed with reduced", [r for r in rows if r.tissue != "reduced"]),
        ("all", rows),
    ):
        n = len(chosen)
        print(
            f"{label}: {n} cases, same verdict word {sum(r.verdict for r in chosen)}/{n}, same answer "
            f"{sum(r.same for r in chosen)}/{n}; right: reduced {sum(r.right_reduced for r in chosen)}/{n}, "
            f"finite elements {sum(r.right_fe for r in chosen)}/{n}"
        )
    reduced, fe = np.array([r.seconds_reduced for r in rows]), np.array([r.seconds_fe for r in rows])
    print(
        "seconds a case (processor time, one core): "
        f"reduced median {np.median(reduced):.1f}, most {reduced.max():.1f}; "
        f"finite elements median {np.median(fe):.1f}, most {fe.max():.1f}; "
        f"solves median {np.median([r.solves for r in rows]):.0f}"
    )


if __name__ == "__main__":
    main()
