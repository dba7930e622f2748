"""Rubber under homogeneous deformation refitted by the sheet's laws, from published data: tests laws and fits.

Run with ``python benchmarks/rubber.py``; docs/validation/rubber.md comments on what it prints. The data (three
materials: uniaxial, pure shear, equibiaxial) are those of the set ``rubber_hyperelastic`` of docs/data.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import h5py
import numpy as np
from acquire import datasets

from skinrig_solver import Cost, Experiment, ModelInfo, Parameter, Result
from skinrig_solver.fit.cases import Case
from skinrig_solver.fit.optimisers import Optimum, minimise
from skinrig_solver.fit.problem import Problem
from skinrig_solver.fit.variables import Free, Variables
from skinrig_solver.laws import LAWS

MATERIALS = ("Treloar_1944", "Kawabata_1981", "Meunier_2008")
MODES = {"UT": "uniaxial", "PS": "pure shear", "ET": "equibiaxial"}
MPA = 1e6


@dataclass(frozen=True)
class Rubber:
    """An incompressible block in plane stress: a sum of one law's energies, each with its own parameters ``pN``.

    The drive is ``stretch_1``, ``stretch_2``; the channel is the nominal stress along 1 [Pa]. ``time`` only numbers the
    points, and the instrument of its experiments has no meaning.
    """

    law: str
    names: tuple[tuple[str, ...], ...]

    @property
    def info(self) -> ModelInfo:
        parameters = tuple(
            Parameter(n, "", -1e9, 1e9, 0.0, "of the law's term", "") for names in self.names for n in names if n
        )
        return ModelInfo(f"rubber_{self.law}", "sheet", parameters, ("stress",), "homogeneous deformation", "")

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        one, two = experiment.drive["stretch_1"], experiment.drive["stretch_2"]
        stress, slopes = np.zeros(one.size), np.zeros((one.size, len(sensitivities)))
        for names in self.names:
            p = np.array([*(parameters[n] if n else 0.0 for n in names), 0.0])  # no bulk modulus: J = 1
            if self.law == "ogden":
                p[1:4:2] = np.where(p[1:4:2] == 0.0, 1.0, p[1:4:2])  # an absent term's exponent must not be zero
            for k in range(one.size):
                value, by_p = _nominal(self.law, p, one[k], two[k])
                stress[k] += value
                for j, n in enumerate(names):
                    if n in sensitivities:
                        slopes[k, sensitivities.index(n)] += by_p[j]
        found = {"stress": slopes} if sensitivities else None
        return Result(experiment.time, {"stress": stress}, tuple(sensitivities), found, Cost())


def _nominal(law: str, p: np.ndarray, one: float, two: float) -> tuple[float, np.ndarray]:
    """Nominal stress along 1 of stretches (one, two, 1/(one two)) with the third direction free, and d/dp."""
    C = np.array([one**2, two**2, (one * two) ** -2, 0.0, 0.0, 0.0])
    S, D, dS = np.empty(6), np.empty((6, 6)), np.zeros((p.size, 6))
    LAWS[law].point(C, p, True, S, D, dS)
    return (S[0] * C[0] - S[2] * C[2]) / one, (dS[:, 0] * C[0] - dS[:, 2] * C[2]) / one


Tables = Mapping[str, Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]]


@cache
def tests() -> Tables:
    """The published tests; see `read`."""
    return read(datasets.folder("rubber_hyperelastic") / "data.h5")


def read(path: Path) -> Tables:
    """material -> mode -> stretches 1 and 2, nominal stress [Pa], each of shape (points,).

    The file holds deformation gradients and stresses [MPa] of shape (points, 3, 3). Raises ValueError for a stress that
    is not Piola's first.
    """
    found: dict[str, dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
    with h5py.File(path) as file:
        for material in MATERIALS:
            for mode in MODES:
                group = file[material][mode]
                if (kind := group.attrs["stress_type"]) != "PK1":
                    raise ValueError(f"{path}: {group.name}: stress is {kind}, not PK1")
                F, P = group["F"][:], group["stress"][:]
                found.setdefault(material, {})[mode] = F[:, 0, 0], F[:, 1, 1], MPA * P[:, 0, 0]
    return found


def cases(material: str, modes: Sequence[str], relative: bool) -> list[Case]:
    """One case a mode. Residuals are relative to each stress (as published errors are), or to the largest."""
    found = []
    for mode in modes:
        one, two, stress = tests()[material][mode]
        order = np.flatnonzero(np.abs(stress) > 0.0)
        one, two, stress = one[order], two[order], stress[order]
        experiment = Experiment(
            "microrobot", np.arange(float(one.size)), {"stretch_1": one, "stretch_2": two}, {}, f"{material} {mode}"
        )
        size = np.maximum(np.abs(stress), 0.1 * np.abs(stress).max()) if relative else np.abs(stress).max() + 0 * stress
        largest = float(np.abs(stress).max())
        found.append(Case(mode, experiment, {"stress": stress}, {"stress": largest}, {"stress": largest / size}))
    return found


OGDEN = Rubber("ogden", (("mu1", "alpha1", "mu2", "alpha2"), ("mu3", "alpha3", "", "")))
YEOH = Rubber("yeoh", (("c10", "c20", "c30"),))
OGDEN_1972 = {"mu1": 0.618, "alpha1": 1.3, "mu2": 0.00118, "alpha2": 5.0, "mu3": -0.00981, "alpha3": -2.0}
STARTS = {
    "ogden": (  # moduli positive with positive exponents, and the other way round: each term stores energy
        Free("mu1", 0.3 * MPA, 1e3, 5 * MPA, True),
        Free("alpha1", 2.0, 0.5, 4.0, False),
        Free("mu2", 1e-3 * MPA, 1e-1, 1 * MPA, True),
        Free("alpha2", 6.0, 3.0, 30.0, False),
        Free("mu3", -0.02 * MPA, -1 * MPA, -1.0, False),
        Free("alpha3", -2.0, -12.0, -0.5, False),
    ),
    "yeoh": (
        Free("c10", 0.2 * MPA, 1e3, 5 * MPA, True),
        Free("c20", 0.0, -1 * MPA, 1 * MPA, False),
        Free("c30", 1e-4 * MPA, -1 * MPA, 1 * MPA, False),
    ),
}


def refit(model: Rubber, material: str, modes: Sequence[str] = tuple(MODES), relative: bool = True) -> Optimum:
    """Fit a law to a material's tests together."""
    variables = Variables(model.info, STARTS[model.law], (), {})
    return minimise(Problem(model, cases(material, modes, relative), variables), "trust-region", 400, 1e-10)


def values(model: Rubber, optimum: Optimum) -> dict[str, float]:
    return Variables(model.info, STARTS[model.law], (), {}).values(optimum.evaluation.z)


@dataclass(frozen=True)
class Misfit:
    """Of one mode: rms error over the largest stress, coefficient of determination, mean relative error (all in 1)."""

    rms: float
    determination: float
    relative: float


def misfit(model: Rubber, parameters: Mapping[str, float], material: str, mode: str) -> Misfit:
    (case,) = cases(material, (mode,), False)
    data = case.data["stress"]
    off = model.simulate(case.experiment, parameters).channels["stress"] - data
    return Misfit(
        float(np.sqrt(np.mean(off**2)) / np.abs(data).max()),
        float(1.0 - off @ off / ((data - data.mean()) @ (data - data.mean()))),
        float(np.mean(np.abs(off) / np.maximum(np.abs(data), 0.1 * np.abs(data).max()))),
    )


def _row(name: str, model: Rubber, parameters: Mapping[str, float], material: str, fitted: Sequence[str]) -> str:
    cells = []
    for mode in MODES:
        m = misfit(model, parameters, material, mode)
        mark = "" if mode in fitted else " (predicted)"
        cells.append(f"{100 * m.rms:.1f} %, {100 * m.relative:.1f} %, {m.determination:.4f}{mark}")
    return f"| {name} | " + " | ".join(cells) + " |"


def _words(parameters: Mapping[str, float]) -> str:
    return ", ".join(
        f"{n} {v:.3g}" if n.startswith("alpha") else f"{n} {v / MPA:.3g} MPa" for n, v in parameters.items()
    )


def main() -> None:
    try:
        tests()
    except datasets.DatasetMissing as error:
        print(f"skipped: {error}")
        return
    for material in tests():
        print(f"\n### {material.replace('_', ' ')}")
        print("| law | " + " | ".join(MODES.values()) + " |\n|---|---|---|---|")
        found = []
        for name, model, modes in (
            ("Ogden, three terms", OGDEN, tuple(MODES)),
            ("Yeoh", YEOH, tuple(MODES)),
            ("Yeoh, from uniaxial alone", YEOH, ("UT",)),
        ):
            parameters = values(model, refit(model, material, modes))
            found.append(f"- {name}: {_words(parameters)}")
            print(_row(name, model, parameters, material, modes))
        if material == "Treloar_1944":
            published = {n: v * (1.0 if n.startswith("alpha") else MPA) for n, v in OGDEN_1972.items()}
            print(_row("Ogden 1972, as published", OGDEN, published, material, tuple(MODES)))
        print("\n" + "\n".join(found))


if __name__ == "__main__":
    main()
