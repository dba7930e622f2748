"""Make the benchmark's cases: folders of bundles, and apart from them a key that names each hidden effect.

    python benchmarks/rigs/make.py -o out/rigs                     # out/rigs/cases/<case>/<run>, out/rigs/key.json
    python benchmarks/rigs/make.py -o out/rigs --only servo piezo --seeds 3

Every case is checked when made: its model is fitted as it is (`before`) and with the true effect in its true form at
its true strength (`after`), both as rms of the residual over the noise put in.
"""

from __future__ import annotations

import argparse
import json
import sys
import time as clock
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[2]))

from acquire.recording import Recording, RunInfo, Series, write_bundle
from benchmarks.rigs import machine_models, models
from benchmarks.rigs.worlds import drives, loops, machines, series, static
from benchmarks.rigs.worlds.tools import Run, Step, World, passed, spread

FRICTION = ("coulomb_friction", "stribeck_friction", "dahl_friction")
LOOP = ("hysteresis", "dahl_friction", "backlash")
CUT = ("saturation", "lower_saturation")
LAG = ("delay", "low_pass")
BENT = ("cubic_stiffness", "quadratic_error")


@dataclass(frozen=True)
class Case:
    """A kind of rig: ``exact`` are the effect names that are right, ``near`` those of the same family; ``stages`` where
    it may be placed; ``sizes`` the range of strengths (log-uniform). No ``exact``: nothing is hidden, and ``near`` is
    what the rig has a tiny bit of (a lag of a tenth of a sample)."""

    name: str
    world: Callable[[np.random.Generator, float], World]
    model: str
    exact: tuple[str, ...] = ()
    near: tuple[str, ...] = ()
    stages: tuple[str, ...] = ()
    sizes: tuple[float, float] = (0.0, 0.0)


CASES = {
    c.name: c
    for c in (
        Case("servo", drives.servo, "Servo", FRICTION[:2], FRICTION, ("actuator",), (0.01, 1)),
        Case("joint", drives.joint, "Joint", FRICTION[:2], FRICTION, ("actuator",), (0.004, 0.6)),
        Case("cylinder", drives.cylinder, "Cylinder", FRICTION[1:], FRICTION, ("actuator",), (0.02, 1)),
        Case("cart", loops.cart, "Cart", FRICTION[:1], FRICTION, ("actuator",), (0.015, 0.6)),
        Case("cart_net", loops.cart_net, "CartNet", FRICTION[:1], FRICTION, ("actuator",), (0.015, 0.6)),
        Case("piezo", static.piezo, "Piezo", ("hysteresis",), LOOP, ("actuator", "sensor"), (0.01, 0.3)),
        Case("magnet", static.magnet, "Magnet", ("hysteresis",), LOOP, ("actuator", "sensor"), (0.004, 0.5)),
        Case("bearing", static.bearing, "Bearing", LOOP[:2], LOOP, ("tissue",), (0.02, 1)),
        Case("bouc_wen", loops.bouc_wen, "Oscillator", LOOP[:2], LOOP, ("tissue",), (0.05, 1)),
        Case("dead_valve", series.dead_valve, "Valve", ("dead_zone",), (), ("actuator",), (0.02, 0.6)),
        Case("dead_motor", series.dead_motor, "Motor", ("dead_zone",), FRICTION[:2], ("actuator",), (0.02, 0.6)),
        Case("gear", series.gear, "Gear", ("backlash",), LOOP, ("interface", "sensor"), (0.003, 0.4)),
        Case("dryer", series.dryer, "Dryer", ("delay",), ("low_pass",), ("actuator", "sensor"), (0.008, 1.5)),
        Case("network", series.network, "Actuator", ("delay",), ("low_pass",), ("timing", "sensor"), (0.1, 15)),
        Case("clamp", series.clamp, "Regulator", ("leak",), (), ("actuator", "sensor"), (0.005, 0.2)),
        Case("two_axis", static.two_axis, "TwoAxis", ("crosstalk",), (), ("sensor",), (0.005, 0.3)),
        Case("load_cell", static.load_cell, "LoadCell", ("creep",), (), ("interface", "sensor"), (0.002, 0.2)),
        Case("polymer", static.polymer, "Polymer", ("creep",), ("low_pass",), ("tissue", "sensor"), (0.002, 0.4)),
        Case("rubber", static.rubber, "Rubber", ("preconditioning",), (), ("tissue", "sensor"), (0.02, 0.4)),
        Case("tissue", static.tissue, "Tissue", ("preconditioning",), (), ("tissue", "sensor"), (0.02, 0.5)),
        Case("tank", loops.tank, "Tank", CUT[:1], CUT, ("tissue", "sensor"), (0.03, 0.8)),
        Case("shaker", series.shaker, "Shaker", CUT[:1], (*CUT, "quadratic_error"), ("actuator",), (0.02, 0.6)),
        Case("drift", static.load_cell_drift, "LoadCell", ("drift",), (), ("interface", "sensor"), (0.001, 0.1)),
        Case("thermocouple", static.thermocouple, "Thermocouple", ("low_pass",), ("delay",),
             ("sensor", "processing"), (0.05, 30)),
        Case("slew_valve", series.slew_valve, "Follower", ("slew_limit",), ("low_pass",),
             ("actuator", "sensor"), (0.4, 6)),
        Case("encoder", static.encoder, "Encoder", ("quantisation",), (), ("interface", "sensor"), (0.004, 1)),
        Case("silverbox", loops.silverbox, "Silverbox", ("cubic_stiffness",), BENT, ("tissue",), (0.003, 1)),
        Case("pendulum", drives.pendulum, "Pendulum", ("cubic_stiffness",), BENT, ("actuator",), (0.15, 1.2)),
        Case("voice_coil", drives.voice_coil, "VoiceCoil", ("position_dependent_gain",), (),
             ("actuator",), (0.003, 0.8)),
        Case("tow", drives.tow, "Tow", ("quadratic_drag",), (), ("actuator",), (0.02, 1)),
        Case("stage", drives.stage_damped, "Stage", ("viscous_drag",), (), ("actuator",), (0.004, 1)),
        Case("balance", static.balance, "Balance", ("gain",), (), ("sensor",), (0.005, 0.2)),
        Case("geared_servo", machines.geared_servo, "GearedServo", ("backlash",), LOOP,
             ("actuator", "interface", "sensor"), (0.004, 0.3)),
        Case("loggers", machines.loggers, "Loggers", ("delay",), LAG, ("timing",), (0.3, 8)),
        Case("rack", machines.rack, "Rack", FRICTION[:2], FRICTION, ("actuator",), (0.02, 1)),
        Case("damper", machines.damper, "Damper", ("quadratic_drag",), (), ("actuator",), (0.02, 0.6)),
        Case("propeller", machines.propeller, "Propeller", ("low_pass",), LAG, ("actuator", "sensor"), (0.01, 0.3)),
        Case("battery", machines.battery, "Battery", ("creep",), ("low_pass",), ("actuator", "sensor"), (0.02, 1)),
        Case("swing", machines.swing, "Swing", ("quadratic_drag",), (), ("actuator",), (0.05, 1)),
        Case("plucked", machines.plucked, "Plucked", ("cubic_stiffness",), BENT, ("actuator",), (0.02, 0.6)),
        Case("sticky_valve", machines.sticky_valve, "FlowLoop", (*LOOP, "dead_zone"), FRICTION,
             ("actuator",), (0.3, 6)),
        Case("servo_null", drives.servo_coasting, "Servo"),
        Case("joint_null", drives.joint_rubbing, "JointWithFriction", near=FRICTION),
        Case("cylinder_null", drives.cylinder_greased, "Cylinder"),
        Case("oscillator_null", loops.oscillator, "Oscillator"),
        Case("valve_null", series.valve_null, "Valve", near=LAG),
        Case("motor_null", series.motor_null, "Motor", near=LAG),
        Case("dryer_null", lambda rng, size: series.dryer(rng, spread(rng, 0.2, 1.0)), "DryerWithDelay", near=LAG),
        Case("tanks_null", series.two_tanks, "Cascade"),
        Case("circuit_null", series.circuit, "Circuit", near=LAG),
        Case("piezo_null", static.piezo_null, "Piezo"),
        Case("load_cell_null", static.load_cell_null, "LoadCell"),
        Case("two_axis_null", static.two_axis_null, "TwoAxis"),
        Case("loggers_null", machines.loggers_null, "Loggers", near=LAG),
        Case("propeller_null", machines.propeller_null, "Propeller", near=LAG),
        Case("battery_null", machines.battery_null, "Battery"),
        Case("sticky_valve_null", machines.sticky_valve_null, "FlowLoop", near=LAG),
    )
}  # fmt: skip


def build(case: Case, seed: int) -> tuple[World, float]:
    """The world of one case and the size of its effect; the same for the same seed on every machine."""
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode())])
    size = spread(rng, *case.sizes) if case.exact else 0.0
    world = case.world(rng, size)
    if not case.exact:
        world = replace(world, truth={})
    if rng.random() < 0.25:  # a quarter of the rigs comes with one recording only
        world = replace(world, runs=world.runs[:1])
    return world, size


def recording(run: Run, case: Case, number: int) -> Recording:
    info = RunInfo(f"{case.name}-{number}", case.name.split("_null")[0], "", status="imported", specimen="rig")
    return Recording(
        info,
        {k: Series(v, run.time, unit) for k, (v, unit) in run.streams.items()},
        {k: Series(v, run.time, unit) for k, (v, unit) in run.setpoints.items()},
    )


class TrueTap:
    """Puts the true effect, in its true form, where it belongs."""

    def __init__(self, truth: dict[str, Callable[[float], Step]], dt: float) -> None:
        self.steps = {name: make(dt) for name, make in truth.items()}

    def __call__(self, name: str, values: Any, **about: Any) -> Any:
        if name not in self.steps:
            return values
        if np.ndim(values):
            return passed(self.steps[name], np.asarray(values), **about)
        return self.steps[name](values, **about)


def fitted(
    world: World, model: Any, truth: dict[str, Callable[[float], Step]], also: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """Residual over noise (1: all explained) with the model's own parameters fitted, and these; ``also`` is another
    start."""
    sets = []
    for run in world.runs:
        data = {k: v for k, (v, _) in run.streams.items()}
        data |= {f"setpoint_{k}": v for k, (v, _) in run.setpoints.items()}
        observe = getattr(model, "observe", lambda time, data: data)
        errors = observe(run.time, run.error)
        floor = {c: float(np.sqrt(np.mean(errors[c] ** 2))) for c in model.channels}
        sets.append((run, data, observe(run.time, data), floor))

    def residual(x: np.ndarray) -> np.ndarray:
        values = {}
        for p, c in zip(model.parameters, x, strict=True):
            values[p.name] = (
                p.default * (p.high / p.low) ** (c / 2) if p.scale == "log" else p.default + c * (p.high - p.low) / 2
            )
        parts = []
        for run, data, seen, floor in sets:
            made = model.simulate(run.time, data, values, TrueTap(truth, run.dt))
            parts += [(seen[c] - made[c]) / floor[c] for c in model.channels]
        return np.nan_to_num(np.concatenate(parts), nan=1e6, posinf=1e6, neginf=-1e6)

    zero = np.zeros(len(model.parameters))
    best, at = np.inf, zero
    known = [p.name in world.known for p in model.parameters]
    if all(known):  # only where both are linear parameters
        values = [(world.known[p.name] - p.default) / (0.5 * (p.high - p.low)) for p in model.parameters]
        also = np.array(values)
    for start in (zero, None, also):
        if start is None and best > 1.5:  # a first, forgiving pass, for starts that are far off
            start = least_squares(residual, zero, loss="soft_l1", f_scale=10.0, max_nfev=40, diff_step=1e-5).x
        if start is None or (start is also and best < 1.5):
            continue
        fit = least_squares(residual, start, max_nfev=60, diff_step=1e-5)
        for x in (start, fit.x):
            rms = float(np.sqrt(np.mean(residual(x) ** 2)))
            if rms < best:
                best, at = rms, x
    return best, at


def owner(model: str) -> ModuleType:
    """The file that has a model."""
    return machine_models if hasattr(machine_models, model) and not hasattr(models, model) else models


def make(output: Path, names: list[str], seeds: list[int]) -> None:
    """Write bundles and key of the cases that ``output`` lacks."""
    path = output / "key.json"
    key = json.loads(path.read_text()) if path.exists() else {}
    for name in names:
        case = CASES[name]
        for seed in seeds:
            label = f"{name}-{seed}"
            if label in key:
                continue
            begin = clock.perf_counter()
            world, size = build(case, seed)
            for k, run in enumerate(world.runs):
                write_bundle(recording(run, case, k), output / "cases" / label / f"run{k + 1}")
            made = clock.perf_counter()
            model = getattr(owner(case.model), case.model)()
            before, at = fitted(world, model, {})
            after = fitted(world, model, dict(world.truth), at)[0] if world.truth else before
            source = f"{Path(str(owner(case.model).__file__)).name}:{case.model}"
            key[label] = {
                "model": source, "exact": case.exact, "near": case.near, "stages": case.stages, "size": size,
                "before": before, "after": after, "recordings": len(world.runs),
                "samples": sum(r.n for r in world.runs) * len(model.channels),
            }  # fmt: skip
            path.write_text(json.dumps(key, indent=1) + "\n")
            print(
                f"{label:18} size {size:8.4g}  gap {before:8.2f} -> {after:6.2f}  made in {made - begin:4.1f} s,"
                f" checked in {clock.perf_counter() - made:4.1f} s",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/rigs"))
    parser.add_argument("--only", nargs="+", default=list(CASES), choices=CASES, metavar="CASE")
    parser.add_argument("--seeds", type=int, default=2, help="how many of every kind (nulls: one more)")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    given = parser.parse_args()
    for extra, names in (
        (0, [n for n in given.only if CASES[n].exact]),
        (1, [n for n in given.only if not CASES[n].exact]),
    ):
        make(given.output, names, list(range(given.first, given.first + given.seeds + extra)))


if __name__ == "__main__":
    main()
