"""The judgement of an instrument by recordings of reference specimens: a diagnosis without skin, put beside the
tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from scipy.linalg import block_diag

from acquire.provenance import versions
from acquire.qualifications import (
    SCHEMA,
    VALID_DAYS,
    Bound,
    Covariance,
    Finding,
    Parameter,
    Qualification,
    day_of,
    serial_of,
)
from acquire.recording.model import Recording
from gap.data.signatures import HUM
from gap.data.tolerances import Tolerance, tolerances
from gap.decision.classes import Cause
from gap.diagnosis import Diagnosis, DiagnosisError, Tell, diagnose
from gap.qualify.steps import STANDARD
from gap.report.parameters import covariance, of_cause, rounded
from protocols.specimens import SPECIMENS
from sim_devices.chain import FloatArray

OF_SKIN = ("height", "force")
"""Blocks whose parameters are a person's."""


@dataclass(frozen=True)
class Judged:
    """A qualification and the diagnosis that it was read from."""

    qualification: Qualification
    diagnosis: Diagnosis


def qualify(
    recordings: Sequence[Recording],
    *,
    serial: str = "",
    valid_days: float = VALID_DAYS,
    full: bool = False,
    jobs: int = 1,
    tell: Tell = lambda stage, share: None,
) -> Judged:
    """Judge an instrument by its recordings of reference specimens; others are not asked.

    ``full`` tries more effects, and pairs. Raises DiagnosisError where there is no reference, or no single instrument.
    """
    references = _references(recordings)
    serial = _serial_number(references, serial)
    d = diagnose(references, quick=not full, jobs=jobs, tell=tell)
    return Judged(_document(references, d, serial, valid_days, full), d)


def _references(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings of reference specimens, which must be of one instrument."""
    references = [r for r in recordings if r.info.specimen in SPECIMENS]
    if not references:
        raise DiagnosisError("no recording of a reference specimen: there is nothing to qualify by")
    if len({r.info.instrument for r in references}) > 1:
        raise DiagnosisError("recordings of several instruments: qualify one at a time")
    return references


def _serial_number(references: Sequence[Recording], stated: str) -> str:
    """The instrument's serial number, ``stated`` or recorded; '' where it is neither."""
    serials = {stated, *(serial_of(r.info) for r in references)} - {""}
    if len(serials) > 1:
        raise DiagnosisError(f"recordings of several serial numbers ({', '.join(sorted(serials))})")
    return next(iter(serials), "")


def _document(
    references: Sequence[Recording], d: Diagnosis, serial: str, valid_days: float, full: bool
) -> Qualification:
    """The qualification that a diagnosis of the references gives."""
    doubted = list(d.doubts)
    parameters, spread = _parameters(d)
    findings = [] if doubted else _findings(d)
    off = {name: p for name, p in parameters.items() if p.passed is False}
    info = references[-1].info
    return Qualification(
        schema=SCHEMA,
        instrument=info.instrument,
        device=info.device,
        serial=serial,
        date=_date(references),
        valid_days=valid_days,
        passed=not (findings or off or doubted or d.verdict.verdict == "unknown"),
        verdict=d.verdict.verdict,
        sentences=tuple(_sentences(d, findings, off, doubted, full)),
        findings=tuple(findings),
        doubts=tuple(doubted),
        parameters=parameters,
        covariance=spread,
        effects=_bounds(d),
        noise=_noise(d),
        checked=tuple(dict.fromkeys(_labelled(r) for r in references)),
        not_checked=_not_checked(references),
        recordings=tuple(r.info.id for r in references),
        minutes=rounded(sum(_duration(r) for r in references) / 60.0),
        software=dict(versions()),
    )


def _date(references: Sequence[Recording]) -> datetime:
    """When the oldest of them was made: what it showed holds from then on; now, where none tells."""
    days = [day for r in references if (day := day_of(r.info)) is not None]
    return min(days, default=datetime.now(UTC)).replace(microsecond=0)


def _findings(d: Diagnosis) -> list[Finding]:
    return [_finding(d, d.verdict.causes[0])] if d.verdict.claims else []


def _finding(d: Diagnosis, cause: Cause) -> Finding:
    return Finding(
        effect=" + ".join(e.name for e in cause.effects),
        **{"class": cause.names},
        probability=rounded(cause.probability),
        parameters=of_cause(d, cause),
        meaning=" ".join(e.meaning for e in cause.effects),
        remedy=" ".join(e.remedy for e in cause.effects),
    )


def _parameters(d: Diagnosis) -> tuple[dict[str, Parameter], Covariance | None]:
    """The instrument's numbers of the null's fit, each beside its tolerance, and their covariance."""
    stated = tolerances(d.recordings[0].info.instrument).get("quantities", {})
    temper = d.verdict.posterior.temper
    out: dict[str, Parameter] = {}
    names: list[str] = []
    blocks: list[FloatArray] = []
    for block, problem in d.problems.items():
        if block in OF_SKIN:
            continue
        fitted = d.comparison.null.fits[block]
        keys, matrix = covariance(problem, fitted, temper[block])
        quantities = problem.quantities(fitted.nuisance)
        chosen = [k for k, key in enumerate(keys) if key in stated and key not in out and matrix[k, k] > 0.0]
        for k in chosen:
            value, unit = quantities[keys[k]]
            out[keys[k]] = _judged(value, float(np.sqrt(matrix[k, k])), unit, stated[keys[k]])
        if chosen:
            names += [keys[k] for k in chosen]
            blocks.append(matrix[np.ix_(chosen, chosen)])
    if not names:
        return out, None
    whole = block_diag(*blocks)
    rows = tuple(tuple(rounded(v) for v in row) for row in whole.tolist())
    return out, Covariance(names=tuple(names), matrix=rows)


def _judged(value: float, se: float, unit: str, tolerance: Tolerance) -> Parameter:
    return Parameter(
        value=rounded(value),
        se=rounded(se),
        unit=unit,
        nominal=tolerance.nominal,
        tolerance=tolerance.value,
        passed=abs(value - tolerance.nominal) <= tolerance.value,
        like=tolerance.like,
    )


def _bounds(d: Diagnosis) -> dict[str, Bound]:
    """For each effect, the strength that would have been seen, of the form that hides best."""
    out: dict[str, Bound] = {}
    for screened in d.comparison.screened:
        c = screened.candidate
        p = next((p for p in c.parameters if p.null is not None), None)
        bound = d.bounds.get(c.key, np.inf)
        if p is None or not np.isfinite(bound) or bound > max(abs(p.low), abs(p.high)):
            continue
        known = out.get(c.name)
        if known is None or (known.parameter == p.name and bound > known.value):
            out[c.name] = Bound(parameter=p.name, value=rounded(bound), unit=p.unit)
    return dict(sorted(out.items()))


def _noise(d: Diagnosis) -> dict[str, dict[str, object]]:
    out: dict[str, dict[str, object]] = {}
    for problem in d.problems.values():
        channels, noise = getattr(problem, "channels", ()), getattr(problem, "noise", ())
        for channel, sigma in zip(channels, noise, strict=True):
            if sigma > 0:
                unit = d.recordings[0].streams[channel].unit if channel in d.recordings[0].streams else ""
                out.setdefault(channel, {"sd": rounded(float(sigma)), "unit": unit})
    return out


def _labelled(r: Recording) -> str:
    known = r.info.specimen_properties
    numbers = ", ".join(SPECIMENS[r.info.specimen].property(key).in_words(value) for key, value in known.items())
    return f"{r.info.specimen} ({numbers})" if numbers else r.info.specimen


def _not_checked(references: Sequence[Recording]) -> tuple[str, ...]:
    """Effects that the standard set would have separated besides, and those that no reference tells."""
    instrument = references[0].info.instrument
    had = {r.info.specimen for r in references}
    left = [
        f"{s.name}: {', '.join(s.separates)}"
        for s in SPECIMENS.values()
        if instrument in s.instruments and s.name not in had
    ]
    short = {step.specimen for step in STANDARD.get(instrument, ())} - had
    return (
        *left,
        *(["the standard set is not complete"] if short else []),
        "the contact with skin: preload, recoil, slip",
    )


def _duration(r: Recording) -> float:
    ends = [s.time[[0, -1]] for s in r.streams.values() if len(s.time)]
    return float(max(e[1] for e in ends) - min(e[0] for e in ends)) if ends else 0.0


def _sentences(
    d: Diagnosis, findings: Sequence[Finding], off: Mapping[str, Parameter], doubted: Sequence[str], full: bool
) -> list[str]:
    if doubted:
        return [f"Not believed: {text}." for text in doubted]
    said = []
    for f in findings:
        others = [name for name in f.indistinguishable if name != f.effect]
        beside = f" (or {', '.join(others)}, which these references cannot tell from it)" if others else ""
        said.append(f"Not passed: {f.effect}{beside}, probability {f.probability:.2f}. {f.meaning} {f.remedy}".strip())
    if not findings and d.verdict.verdict == "unknown":
        marks = [s.text for s in d.signatures if s.effect == HUM]
        seen = f": {'; '.join(marks)}" if marks else ""
        said.append(f"Not passed: the references show something that no known effect explains{seen}.")
    said += _beyond_tolerance(d, findings[0].effect if findings else "", off, full)
    return said or [
        "Passed: no effect of the instrument shows on the references, and all parameters are within tolerance."
    ]


def _beyond_tolerance(d: Diagnosis, found: str, off: Mapping[str, Parameter], full: bool) -> list[str]:
    """Parameters that did not pass: those that the ``found`` effect explains, and the others, each with the effect that
    would look so; and that more is off than was found."""
    left = [name for name, p in off.items() if not found or not _within_beside(d, name, p)]
    said = []
    for name, p in off.items():
        if name not in left:
            said.append(f"Not passed: {name} is beyond its tolerance, which {found} explains.")
            continue
        like = f" ({p.like} would look so)" if p.like else ""
        said.append(f"Not passed: {name}{like} is beyond its tolerance{f' beside {found}, too' if found else ''}.")
    if found and left:
        pairs = "" if full else ", or look for pairs of effects with --full"
        said.append(
            f"More than {found} is off: it does not explain {', '.join(left)}. Mend it and qualify again{pairs}."
        )
    return said


def _within_beside(d: Diagnosis, name: str, p: Parameter) -> bool:
    """Whether a parameter is within its tolerance once the effect that was found is part of the simulation."""
    found = [problem.quantities(d.best.fits[block].nuisance) for block, problem in d.problems.items()]
    values = [quantities[name][0] for quantities in found if name in quantities]
    return all(abs(value - p.nominal) <= (p.tolerance or 0.0) for value in values)
