"""The diagnosis in three sentences, for whoever ran the measurement."""

from __future__ import annotations

from gap.data.quantities import quantity, significant
from gap.data.signatures import HUM
from gap.decision.classes import Cause
from gap.decision.gaps import gap_without_discrepancy, shrink
from gap.decision.marks import made_by
from gap.decision.verdict import ALIKE, DOUBT, EMPTY, WITHIN
from gap.diagnosis import Diagnosis
from gap.inference.hypothesis import Candidate
from gap.report.breakdown import breakdown
from gap.report.parameters import has_no_size, of_cause
from gap.report.terms import text
from gap.report.words import SPLITS, options, words

UNKNOWN_NEXT = "The cause is not known: the pictures show where to look, and an effect of your own can be added."
ALONE = "No effect was fitted beside the simulation: its parameters are those of a sound instrument and skin."
BOUNDS = "The bounds below say how strong each effect could still be."
SMALL = {
    WITHIN: "and is within twice a stated tolerance: no finding",
    ALIKE: "and a sound instrument within its tolerances shows the same",
}
"""How an effect that is no finding is one, by the rule that says so."""
MOST = 80.0
"""Per cent of the excess that are no longer few."""
DOING = {"load": "loading", "unload": "unloading", "hold": "holding", "rest": "resting"}


def sentences(d: Diagnosis) -> list[str]:
    """How far off the simulation is, its explanation, and how that was tested."""
    if d.verdict.settled_by == EMPTY:
        return [_how_far(d), ALONE]
    if d.verdict.verdict in ("none", "undetectable"):
        return [_how_far(d), _nothing(d), *([BOUNDS] if d.bounds else [])]
    if d.verdict.verdict == "unknown":
        if d.verdict.settled_by == DOUBT:
            return [_how_far(d), _doubted(d)]
        return [_how_far(d), _unknown(d), text(d.term) if d.term is not None else UNKNOWN_NEXT]
    return [_how_far(d), _explained(d, d.verdict.causes[0]), _tested(d, d.verdict.causes[0])]


def _within_noise(d: Diagnosis) -> bool:
    return d.gap_before < d.thresholds.quiet_gap


def _how_far(d: Diagnosis) -> str:
    if _within_noise(d):
        return f"Simulation and measurement agree to within the noise (gap {d.gap_before:.2f}, noise 1)."
    by_phase = breakdown(d)["phase"]
    worst = max(by_phase, key=lambda k: by_phase[k]["before"]) if len(by_phase) > 1 else ""
    # A rig has no skin that is loaded and rests.
    clearly = bool(worst) and "rig" not in d.problems and by_phase[worst]["before"] > 1.2 * d.gap_before
    mostly = f", mostly while {DOING.get(worst, worst)}" if clearly else ""
    return f"The simulation is {significant(d.gap_before)} times the noise off{mostly}."


def _nothing(d: Diagnosis) -> str:
    if d.verdict.causes and d.verdict.settled_by in SMALL:
        what = " and ".join(words(e.name) for e in d.verdict.causes[0].effects)
        apart = d.verdict.settled_by == ALIKE and d.qualified is None
        next_step = "; a qualification would tell them apart" if apart else ""
        return f"{what.capitalize()} would explain what stands out, {SMALL[d.verdict.settled_by]}{next_step}."
    if _within_noise(d):
        if d.verdict.verdict == "none":
            return "No effect of the library is needed to explain these recordings."
        return "No effect stands out: if one acts, it is weaker than what these recordings can show."
    if "rig" in d.problems:
        return "A model that is wrong otherwise could do that as well: no effect stands out beyond it."
    quiet = d.thresholds.quiet_gap
    loud = [
        name for name, p in d.problems.items() if not p.open_law and gap_without_discrepancy(d.null, {name}) >= quiet
    ]
    if not loud:
        return "Skin of another law could do that as well: no effect stands out beyond it."
    where = " and ".join(words(name) for name in loud)
    return f"No effect stands out, though skin plays no part in {where}: more noise, or wider tolerances, would do it."


def _doubted(d: Diagnosis) -> str:
    doubt = d.doubts[0]
    return f"{doubt[0].upper()}{doubt[1:]}. Check the specimen, or measure another one."


def _unknown(d: Diagnosis) -> str:
    if hum := [s.text for s in d.signatures if s.effect == HUM]:
        return f"{'; '.join(hum)}: no effect of the library makes that."
    if not d.verdict.causes:
        return "Nothing in the library explains it."
    what = " and ".join(words(e.name) for e in d.verdict.causes[0].effects)
    if d.verdict.settled_by == "not sure":
        return f"It is not sure what causes it: {what} would explain it, and is not much more probable than all else."
    nearest = f"Nothing in the library explains it: the best candidate, {what},"
    failed = {
        "worse on repeats": "makes a withheld repeat worse",
        "worse elsewhere": "makes withheld recordings of another waveform worse",
        "does not carry over": "does not carry over to another waveform",
        "amid skin of another law": "leaves so much that skin of another law may be all of it",
        "unexplained input": "acts on channels whose input is not explained, as forces that no skin explains",
        "of another form": "leaves a gap in withheld recordings of another waveform",
        "stays behind": "takes away little of withheld recordings",
        "outdone by a rival": "is outdone by another on withheld recordings",
    }
    some = f"takes away only {_share(d):.0f} % of it" if _share(d) < MOST else "is not shown to be the cause"
    return f"{nearest} {failed.get(d.verdict.settled_by, some)}."


def _share(d: Diagnosis) -> float:
    """Per cent of the excess above the noise that the first cause removes, at most 100."""
    return 100 * min(max(shrink(d.gap_before, d.gap_after) or 0.0, 0.0), 1.0)


def _explained(d: Diagnosis, cause: Cause) -> str:
    several = len(cause.effects) > 1
    what = " and ".join(_spoken(e) for e in cause.effects)
    stage = ", ".join(dict.fromkeys(e.stage for e in cause.effects))
    instrument = d.recordings[0].info.instrument
    said = [(e, name, label) for e in cause.effects for name, label in options(e, instrument).items()]
    how = [_said(name, label) for e, name, label in said if label != _spoken(e)]
    named = f"{what.capitalize()} ({'; '.join([stage, *how, *numbers(d, cause)])})"
    sure = f"(probability {cause.probability:.2f})"
    acts = "act" if several else "acts"
    if has_no_size(d, cause):
        marks = [s.text for s in d.signatures if any(made_by(s, e) for e in cause.effects)]
        return f"{what.capitalize()} ({stage}) {acts} {sure}: {'; '.join(marks)}."
    if cause.certain:
        return f"{named} {acts} {sure}: {'; '.join(s.text for s in d.signatures if s.certain)}."
    if _within_noise(d):
        return f"{named} {'stand' if several else 'stands'} out all the same, by {cause.detectability:.0f} σ {sure}."
    return f"{named} {'explain' if several else 'explains'} {_share(d):.0f} % of it {sure}."


def _spoken(effect: Candidate) -> str:
    """An effect's name as a sentence begins with it: of a rig's, its form's, as an advance is no delay to a reader."""
    return words(effect.key.split("@", 1)[0] if "@" in effect.key else effect.name)


def _said(option: str, label: str) -> str:
    """The label of an option as people say it beside others."""
    if option == "tap":
        return f"at {label}"
    return f"all {words(option)}s" if label == "all" else label


def _tested(d: Diagnosis, cause: Cause) -> str:
    if others := [words(n) for n in cause.names[1:]]:
        return f"These data cannot tell it from {' or '.join(others)}."
    if _within_noise(d):
        return f"That nothing acts has probability {d.verdict.posterior.none:.2f}."
    if has_no_size(d, cause):
        return f"In reality: {cause.effects[0].remedy}"
    for split, on in SPLITS.items():
        share = d.shrinks[0][split].value if split in d.shrinks[0] else None
        if share is not None:
            return f"On {on}, withheld from the fit, the gap shrinks by {100 * min(share, 1.0):.0f} %."
    return f"In reality: {cause.effects[0].remedy}"


def numbers(d: Diagnosis, cause: Cause, most: int = 2) -> list[str]:
    """The first parameters of a cause as people write them: ``tau 0.31 s``."""
    out, found = [], of_cause(d, cause)
    for effect in cause.effects:
        for p in effect.parameters[:most]:
            entry = found[p.name if len(cause.effects) == 1 else f"{effect.name}.{p.name}"]
            if "recording" in entry:
                out.append(f"{quantity(entry['in_recording'], 's')} into {entry['recording']}")
            elif p.unit != "choice":
                out.append(f"{words(p.name)} {quantity(entry['value'], p.unit)}")
    return out[: 2 * most]
