"""Computed against published figures for the suction models: prints the tables of docs/validation/suction.md.

Run with ``python benchmarks/validate_suction.py``. Published figures are those that the project notes cite from
papers F and W; nothing here was compared with a real recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from skinrig_solver import Experiment, Result, models

RB, GAMMA, YEOH = (models()[n] for n in ("suction_rubin_bodner", "suction_rubin_bodner_gamma", "suction_yeoh_qlv"))
RATE = {"cutometer": 100.0, "aspiration": 25.0}


def instant(instrument: Any, mbar: float, hold: float, release: float = 0.0, **geometry: Any) -> Experiment:
    time = np.arange(0.0, hold + release + 1e-9, 1.0 / RATE[instrument])
    return Experiment(
        instrument, time, {"pressure": np.where((time > 0) & (time <= hold), -100.0 * mbar, 0.0)}, geometry
    )


def linear(instrument: Any, rate: float, leg: float, **geometry: Any) -> Experiment:
    """A triangle: ``rate`` [mbar/s] up for ``leg`` [s] and down again."""
    time = np.arange(0.0, 2 * leg + 1e-9, 1.0 / RATE[instrument])
    return Experiment(instrument, time, {"pressure": -100.0 * rate * np.minimum(time, 2 * leg - time)}, geometry)


def height(result: Result) -> float:
    """Largest apex height [mm]."""
    return 1e3 * float(result.channels["apex_height"].max())


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


def paper_w_protocols() -> None:
    print("### Every protocol of paper W, parameters of its table\n")
    runs = {f"Cutometer instant {p} mbar, 60 s": instant("cutometer", p, 60.0) for p in (300, 500)}
    runs |= {f"Cutometer linear {r} mbar/s, leg 17.5 s": linear("cutometer", r, 17.5) for r in (10, 15, 20)}
    runs |= {f"aspiration instant {p} mbar, 31 s": instant("aspiration", p, 31.0) for p in (66, 133, 200)}
    runs |= {f"aspiration linear {r} mbar/s, leg 10 s": linear("aspiration", r, 10.0) for r in (15, 20, 30)}
    rows = []
    for name, run in runs.items():
        result = RB.simulate(run, {})
        curve = 1e3 * result.channels["apex_height"]
        rows.append([name, f"{curve.max():.3f}", f"{curve[-1]:.3f}"])
    table(["protocol", "largest apex, mm", "apex at the end, mm"], rows)


def missing_information() -> None:
    print("### What missing information moves: Cutometer instant 300 mbar and aspiration instant 200 mbar\n")
    both = (("cutometer", 300.0, 60.0), ("aspiration", 200.0, 31.0))
    radius = {"cutometer": 1e-3, "aspiration": 4e-3}
    with_muscle = {"layers": {"skin": 1.7e-3, "smas": 3.0e-3, "muscle": 5.0e-3}}

    def pair(
        model: Any = RB, parameters: Mapping[str, float] | None = None, fillet: float | None = None, **geometry: Any
    ) -> tuple[float, float]:
        heights = []
        for instrument, pressure, hold in both:
            options = dict(geometry) if fillet is None else {**geometry, "rim_fillet": fillet * radius[instrument]}
            heights.append(height(model.simulate(instant(instrument, pressure, hold, **options), parameters or {})))
        return heights[0], heights[1]

    def scaled(factor: float) -> dict[str, float]:
        return {f"{layer}.m1": 1000.0 * factor for layer in ("skin", "smas", "muscle")}

    cases = {
        "as assumed": pair(),
        "rim fillet 0.02 opening radii": pair(fillet=0.02),
        "rim fillet 0.05": pair(fillet=0.05),
        "rim fillet 0.2": pair(fillet=0.2),
        "rim fillet 0.3": pair(fillet=0.3),
        "rim friction 0.35": pair(parameters={"friction": 0.35}),
        "rim friction 1.0": pair(parameters={"friction": 1.0}),
        "hardening with the factor γ": pair(GAMMA),
        "m5 = 1 − m2 (skin .973, SMAS .986)": pair(parameters={"skin.m5": 0.973, "smas.m5": 0.986}),
        "bulk resistance m1 / 10": pair(parameters=scaled(0.1)),
        "muscle under the Cutometer as well": pair(**with_muscle),
        "probe pressed on with 0.1 N": pair(parameters={"spring_force": 0.1}),
    }
    base = cases["as assumed"]
    rows = []
    for name, (cutometer, aspiration) in cases.items():
        moved = [f"{100 * (h / b - 1):+.1f} %" for h, b in zip((cutometer, aspiration), base, strict=True)]
        rows.append(
            [name, f"{cutometer:.4f}", moved[0], f"{aspiration:.4f}", moved[1], f"{aspiration / cutometer:.2f}"]
        )
    table(["assumption", "Cutometer, mm", "", "aspiration, mm", "", "ratio"], rows)

    rows = []
    for factor in (0.8, 1.0, 1.2):
        value = height(RB.simulate(instant("cutometer", 300.0, 60.0), {"skin.thickness_factor": factor}))
        rows.append([f"skin {1.7 * factor:.2f} mm", f"{value:.4f}"])
    for opening in (4e-3, 5e-3):
        value = height(RB.simulate(instant("aspiration", 200.0, 31.0, opening_radius=opening), {}))
        rows.append([f"aspiration opening {2e3 * opening:.0f} mm", f"{value:.4f}"])
    for leg, reading in ((17.5, "one leg"), (8.75, "the whole triangle")):
        value = height(RB.simulate(linear("cutometer", 15.0, leg), {}))
        rows.append([f"Cutometer linear 15 mbar/s, t_lin is {reading}", f"{value:.4f}"])
    table(["quantity", "largest apex, mm"], rows)


def ratio_needs() -> None:
    print("### What would bring the aspiration/Cutometer ratio to five\n")
    rows = []
    for symbol in ("skin.mu0", "smas.mu0", "smas.q", "skin.q"):
        for factor in (0.5, 2.0, 4.0):
            value = RB.info.defaults[symbol] * factor
            a = height(RB.simulate(instant("cutometer", 300.0, 60.0), {symbol: value}))
            b = height(RB.simulate(instant("aspiration", 200.0, 31.0), {symbol: value}))
            rows.append([f"{symbol} x {factor:g}", f"{a:.4f}", f"{b:.4f}", f"{b / a:.2f}"])
    table(["change", "Cutometer, mm", "aspiration, mm", "ratio"], rows)


def paper_f() -> None:
    print("### Paper F: fingertip under the Cutometer, Yeoh with QLV (values assumed)\n")
    rows = []
    for pressure in (150, 200, 250, 300, 350, 400, 450):
        result = YEOH.simulate(instant("cutometer", pressure, 60.0, 15.0), {})
        curve = 1e3 * result.channels["apex_height"]
        rows.append([f"{pressure}", f"{curve[500]:.3f}", f"{curve[6000]:.3f}", f"{curve[-1]:.3f}"])
    table(["mbar", "height at 5 s, mm", "at 60 s", "at 75 s"], rows)

    print("ZeroDisp, the bulge that zeroing loses (published 0.05 to 0.09 mm, 0.07 used):\n")
    rows = []
    for modulus in (1.5e4, 2e4, 3e4):
        for opening in (1e-3, 2e-3):
            result = YEOH.simulate(instant("cutometer", 150, 1.0, opening_radius=opening), {"G": modulus})
            rows.append(
                [f"{modulus / 1e3:.0f}", f"{1e3 * opening:.0f}", f"{1e3 * result.notes['zero_displacement']:.3f}"]
            )
    table(["G, kPa", "opening radius, mm", "ZeroDisp, mm"], rows)

    print("Which quantity decides the height at 300 mbar, 5 s (relative change of height per relative change of it):\n")
    run, symbols = (
        instant("cutometer", 300, 5.0),
        ("G", "nu", "c20", "g1", "tau1", "g2", "thickness_factor", "friction", "spring_force"),
    )
    result = YEOH.simulate(run, {}, symbols)
    assert result.sensitivities is not None
    apex, slopes = result.channels["apex_height"][-1], result.sensitivities["apex_height"][-1]
    shares = {s: slopes[j] * YEOH.info.defaults[s] / apex for j, s in enumerate(symbols)}
    for name, value in (("opening_radius", 2e-3), ("rim_fillet", 2e-4)):
        sides = [
            YEOH.simulate(instant("cutometer", 300, 5.0, **{name: value * factor}), {}).channels["apex_height"][-1]
            for factor in (1.05, 0.95)
        ]
        shares[name] = (sides[0] - sides[1]) / (0.1 * apex)
    rows = [[name, f"{value:+.3f}"] for name, value in sorted(shares.items(), key=lambda item: -abs(item[1]))]
    table(["quantity", "elasticity"], rows)


def finger() -> None:
    print("### Paper F: fingertip cross-section, plane strain, 200 mbar between rims 4 mm apart (dimensions assumed)\n")
    model, time = models()["finger_section"], np.linspace(0.0, 1.0, 3)
    rows = []
    for name, options in (
        ("with ridges", {}),
        ("smooth pad", {"ridge_height": 0.0}),
        ("held at the bone", {"support": "bone"}),
        ("epidermis 0.7 mm", {"epidermis": 0.7e-3}),
    ):
        result = model.simulate(
            Experiment("cutometer", time, {"pressure": -2e4 * time}, options), {}, model.info.symbols
        )
        assert result.sensitivities is not None
        rise = result.channels["deflection"][-1]
        shares = result.sensitivities["deflection"][-1] * np.array(list(model.info.defaults.values())) / rise
        rows.append([name, f"{1e3 * rise:.3f}", *(f"{share:+.3f}" for share in shares)])
    table(["case", "rise, mm", *(f"by {s}" for s in model.info.symbols)], rows)


if __name__ == "__main__":
    paper_w_protocols()
    missing_information()
    ratio_needs()
    paper_f()
    finger()
