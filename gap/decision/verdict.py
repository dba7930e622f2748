"""The verdict, and the only file that says one: a table of named rules over a posterior and its held-out tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from gap.decision.classes import Cause
from gap.decision.findings import Findings
from gap.decision.gaps import Shrink, above
from gap.decision.posterior import Posterior
from gap.decision.thresholds import Thresholds
from gap.decision.tolerance import shortest, weakest

EMPTY, UNFINISHED, WITHIN, DOUBT = "nothing to name", "unfinished pair", "within tolerance", "in doubt"
ALIKE, NOISY = "a sound instrument looks alike", "told by its noise"
"""Names of rules that others ask for."""
VERDICTS = ("effect", "several", "none", "unknown", "undetectable")


@dataclass(frozen=True)
class Rule:
    """A named condition; the first that holds settles the verdict. ``text`` gives the numbers compared."""

    name: str
    holds: Callable[[Findings], bool]
    says: Callable[[Findings], str]
    text: Callable[[Findings], str]


@dataclass(frozen=True)
class Verdict:
    """``verdict`` is one of `VERDICTS`; ``posterior`` is consistent with it, ``rules`` tells which rule settled it and
    the numbers it compared. ``held_out`` are the tests of the leading causes, by split."""

    verdict: str
    posterior: Posterior
    rules: tuple[str, ...]

    @property
    def causes(self) -> tuple[Cause, ...]:
        return self.posterior.causes

    @property
    def settled_by(self) -> str:
        """The name of the rule that settled it."""
        return self.rules[0].partition(":")[0]

    @property
    def claims(self) -> bool:
        """Whether an effect is named."""
        return self.verdict in ("effect", "several")


def quiet(f: Findings) -> str:
    """The verdict where no effect is needed."""
    p = f.posterior
    if p.hum or p.gap_before > f.t.unusual_gap:
        return "unknown"
    within = max(p.gap_before, p.gap_worst) <= f.t.quiet_gap
    return "none" if within and p.none >= f.t.sure_none else "undetectable"


def unexplained(f: Findings) -> str:
    """The verdict where the best explanation leaves much: unknown, unless noise read too low may be all of it."""
    return "unknown" if f.posterior.gap_before > f.t.unexplained_gap else quiet(f)


def tolerated(f: Findings) -> str:
    """The verdict where a stated tolerance explains the gap: nothing is unknown then, unless a gap is left."""
    said, p = quiet(f), f.posterior
    explained = not p.hum and p.gap_after <= f.t.unusual_gap
    return "undetectable" if said == "unknown" and explained else said


def spoiled(f: Findings) -> str:
    """The verdict where a named effect fails a test: unknown, where a gap is there to be explained."""
    return "unknown" if f.fitted is not None and f.fitted.before > f.t.unusual_gap else quiet(f)


def _always(said: str) -> Callable[[Findings], str]:
    return lambda f: said


def _lowers_nothing(f: Findings) -> bool:
    if f.fitted is None or f.shows_itself:
        return False
    if f.fitted.fall <= f.t.least_fall:
        return True
    p, before = f.posterior, f.fitted.before
    here = before**2 - f.fitted.after**2 < f.t.least_share * above(before, f.t.quiet_gap)
    in_all = p.gap_before**2 - p.gap_after**2 < f.t.least_of_all * above(p.gap_before, f.t.quiet_gap)
    return here or (p.gap_before > f.t.unusual_gap and in_all and not f.judged_apart)


def _helps(f: Findings) -> bool:
    return any((s.value or 0.0) > f.t.helps or s.squares > f.t.helps_squares for s in f.withheld.values())


def _faint(f: Findings) -> bool:
    return weakest(f.first.hypothesis, f.t.weakest) and not _helps(f)


def _untested(f: Findings) -> bool:
    """Next to nothing stands above the noise, and no withheld recording says that it is the effect's."""
    return f.fitted is not None and f.fitted.before <= f.t.untested_gap and not f.shows_itself and not _helps(f)


def _small(f: Findings) -> bool:
    """Hardly anything is taken away, and it stands out little or no withheld recording says that it is the effect's:
    none can of one that strains a tolerance far, which takes it on in each of them and in many samples."""
    if f.fitted is None or f.shows_itself or f.strained:
        return False
    faint = f.fitted.fall < f.t.faint and f.first.detectability < f.t.seen_faint and f.seen > f.t.seen_marked
    least = all(s.fall < f.t.small_fall for s in (f.fitted, *f.withheld.values()))
    return faint or (bool(f.withheld) and least and not _helps(f))


def _repairs_one(f: Findings) -> bool:
    """One block is repaired at another's cost. An effect that acts is met in all that it changes."""
    return not f.shows_itself and any(s.after > f.t.worse_block * max(s.before, 1.0) for s in f.each.values())


def _worse(split: str, limit: Callable[[Findings], float]) -> Callable[[Findings], bool]:
    def holds(f: Findings) -> bool:
        s = f.held_out.get(split)
        return s is not None and s.after > limit(f) * max(s.before, 1.0) and not _next_to(s, f)

    return holds


def _next_to(s: Shrink, f: Findings) -> bool:
    """Whether an effect makes a withheld gap worse by next to nothing of the gap it removes where it was fitted: its
    parameters are known by the other recordings, to so much."""
    had = f.fitted.before**2 - f.fitted.after**2 if f.fitted is not None else 0.0
    return s.after**2 - s.before**2 < f.t.worse_share * had


def _worse_on_repeats(f: Findings) -> bool:
    return not f.first.happens_once and _worse("repeat", lambda f: f.t.worse_repeat)(f)


def _patched(f: Findings) -> bool:
    """Something for a while that does not get near the noise, or as short as may be, like the rest of a step's answer:
    such patches repair anything a bit. What skin of another law leaves is not its doing where others show it."""
    if f.shows_itself or not f.first.happens_once:
        return False
    p = f.posterior
    left, had = (p.gap_after, p.gap_before) if f.fitted is None else (f.fitted.after, f.fitted.before)
    leaves_most = above(left, f.t.quiet_gap) > f.t.event_leaves * above(had, f.t.quiet_gap)
    in_all = left if f.without_skin > f.t.without_skin else p.gap_after
    leaves = in_all > f.t.patched or (had > f.t.unusual_gap and leaves_most)
    return leaves or shortest(f.first.hypothesis, f.t.weakest)


def _unfinished(f: Findings) -> bool:
    """Two effects that leave a gap where they act: two of the library's forms repair one of another form."""
    left = f.fitted.after if f.fitted is not None else 0.0
    return len(f.first.effects) > 1 and left > f.t.unfinished_pair and not f.shows_itself


def _skin_may(f: Findings) -> bool:
    """Whether the first cause, of the device, may be the rest of skin of another law, or a skin's effect as large."""
    skin = max((c.detectability for c in f.posterior.causes[1:] if c.of_skin), default=0.0)
    overwhelming = f.first.detectability > max(f.t.overwhelming, skin / f.t.like_skin)
    return not (overwhelming or f.without_skin > f.t.without_skin) and not f.first.of_skin


def _repairs_skin(f: Findings) -> bool:
    """Such an effect does not carry over to another waveform."""
    carried = f.held_out.get("waveform")
    if f.fitted is not None and f.fitted.before < f.t.quiet_gap:
        return False
    stays = carried is not None and carried.value is not None and carried.value <= f.t.carries_over
    return stays and _skin_may(f)


def _amid_skin(f: Findings) -> bool:
    """Such an effect, or one of the skin, leaves the simulation by itself far from the data: an effect of skin may
    stand in for part of another law, unless it takes away nearly all and stands out as none of sound skin did."""
    if f.fitted is None or f.fitted.after <= f.t.amid_skin or f.shows_itself:
        return False
    left, had = above(f.fitted.after, f.t.quiet_gap), above(f.fitted.before, f.t.quiet_gap)
    sure = left < f.t.amid_share * had and f.first.detectability > f.t.amid_sure
    return (_skin_may(f) or f.first.of_skin) and not sure


def _of_another_form(f: Findings) -> bool:
    """An effect that nothing without skin shows stands out little, and leaves another waveform above the noise: it may
    stand in for one of another form or at another place, of which it imitates the answer to the first."""
    carried = f.held_out.get("waveform")
    if carried is None or f.shows_itself or f.first.detectability > f.t.amid_sure:
        return False
    shown = f.fitted is None or f.fitted.before >= f.t.quiet_gap
    amid_skin = f.first.of_skin or f.without_skin <= f.t.without_skin
    return shown and amid_skin and carried.after > f.t.left_elsewhere


def _on_unexplained_input(f: Findings) -> bool:
    """The channels that the first cause changes are near the noise anyhow, and those that they have as input are not:
    the load on a robot's axes where skin of another law bends it."""
    quiet_there = f.fitted is not None and f.fitted.before <= f.t.quiet_gap
    return quiet_there and not f.shows_itself and f.input_gap > f.t.input_gap


def _stays_behind(f: Findings) -> bool:
    """On every withheld recording the first cause takes away little of its share where it was fitted, as it may where
    a tolerance takes it on in each of them."""
    if f.strained or f.first.happens_once:
        return False
    fitted = f.fitted.value if f.fitted is not None else None
    carried = [s.value for s in f.withheld.values() if s.value is not None]
    return fitted is not None and bool(carried) and max(carried) < f.t.carried_share * fitted


def _outdone(f: Findings) -> bool:
    """Other effects than the first cause's meet every withheld recording better; at the noise none does."""
    pairs = [(s.after, f.rival[split].after) for split, s in f.withheld.items() if split in f.rival]
    return bool(pairs) and all(max(other, 1.0) < (1.0 - f.t.rival_lead) * max(own, 1.0) for own, other in pairs)


def _told(split: str) -> Callable[[Findings], str]:
    return lambda f: f"gap {f.held_out[split].before:.2f} -> {f.held_out[split].after:.2f} on a withheld {split}"


def _all_told(f: Findings) -> str:
    return ", ".join([*filter(None, [_fall(f)]), *(_told(k)(f) for k in f.withheld)])


def _standing_out(f: Findings) -> str:
    if f.shows_itself and (at := f.first.at_marks):
        return f"gap {at.before:.2f} -> {at.after:.2f} where the samples are marked"
    return f"detectability {f.first.detectability:.1f} >= {f.seen:g}"


def _sure(f: Findings) -> str:
    return f"posterior {f.first.probability:.2f}, {_standing_out(f)}"


def _while(f: Findings) -> str:
    return "as short as may be" if shortest(f.first.hypothesis, f.t.weakest) else "for a while"


def _named(f: Findings) -> str:
    return "several" if len(f.first.effects) > 1 else "effect"


def _fall(f: Findings) -> str:
    return f"gap {f.fitted.before:.2f} -> {f.fitted.after:.2f} in the channels it changes" if f.fitted else ""


def _sized(f: Findings) -> str:
    return f"{f.size} <= {f.t.tolerances:g}"


RULES: tuple[Rule, ...] = (
    Rule(EMPTY, lambda f: not f.posterior.causes, quiet, lambda f: "no effect was fitted"),
    Rule(
        "not detected",
        lambda f: f.posterior.acts < f.t.detect,
        quiet,
        lambda f: f"probability {f.posterior.acts:.2f} that something acts < {f.t.detect:g}",
    ),
    Rule(NOISY, lambda f: f.first.noise > f.t.quiet_gap, _named, _sure),
    Rule(
        "told by its marks",
        lambda f: f.first.certain,
        _named,
        lambda f: f"posterior {f.first.probability:.2f}, a mark in the samples that nothing else leaves",
    ),
    Rule(
        "not seen",
        lambda f: f.first.detectability < f.seen and not f.shows_itself,
        quiet,
        lambda f: f"detectability {f.first.detectability:.1f} < {f.seen:g}",
    ),
    Rule(
        "unexplained",
        lambda f: f.posterior.lacking > f.t.unknown and not f.shows_itself,
        unexplained,
        lambda f: (
            f"probability {f.posterior.lacking:.2f} > {f.t.unknown:g} that no known effect is all: the best one "
            f"leaves {100 * f.posterior.unexplained:.0f} % of the excess, a gap of {f.posterior.gap_after:.2f} in all"
        ),
    ),
    Rule(
        "patched",
        _patched,
        spoiled,
        lambda f: f"an effect {_while(f)} leaves a gap of {f.posterior.gap_after:.2f}, {_fall(f)}".removesuffix(", "),
    ),
    Rule(
        UNFINISHED,
        _unfinished,
        _always("unknown"),
        lambda f: f"several effects leave a gap > {f.t.unfinished_pair:g} where they act: {_fall(f)}",
    ),
    Rule(ALIKE, lambda f: f.size.of_channels and f.size.within(f.t.tolerances, f.seen), tolerated, _sized),
    Rule(WITHIN, lambda f: f.size.within(f.t.tolerances, f.seen), tolerated, _sized),
    Rule(
        "takes nothing away",
        _lowers_nothing,
        spoiled,
        lambda f: f"{_fall(f)}, {f.posterior.gap_before:.2f} -> {f.posterior.gap_after:.2f} in all",
    ),
    Rule("takes little away", _small, spoiled, _all_told),
    Rule("within the noise", _untested, quiet, _fall),
    Rule(
        "worse in another channel",
        _repairs_one,
        _always("unknown"),
        lambda f: ", ".join(f"{name}: gap {s.before:.2f} -> {s.after:.2f}" for name, s in f.each.items()),
    ),
    Rule("as weak as may be", _faint, spoiled, lambda f: "at the low end of its range, and no use elsewhere"),
    Rule("worse on repeats", _worse_on_repeats, _always("unknown"), _told("repeat")),
    Rule("worse elsewhere", _worse("waveform", lambda f: f.t.worse_elsewhere), _always("unknown"), _told("waveform")),
    Rule("does not carry over", _repairs_skin, _always("unknown"), _told("waveform")),
    Rule("amid skin of another law", _amid_skin, _always("unknown"), _all_told),
    Rule("of another form", _of_another_form, spoiled, _all_told),
    Rule(
        "unexplained input",
        _on_unexplained_input,
        quiet,
        lambda f: f"{_all_told(f)}, {f.input_gap:.2f} in those that they have as input",
    ),
    Rule("stays behind", _stays_behind, spoiled, _all_told),
    Rule(
        "outdone by a rival",
        _outdone,
        _always("unknown"),
        lambda f: ", ".join(f"{_told(k)(f)}, a rival {f.rival[k].after:.2f}" for k in f.withheld if k in f.rival),
    ),
    Rule(
        "not sure",
        lambda f: f.first.probability < f.t.sure,
        _always("unknown"),
        lambda f: f"{_sure(f)}, but {f.first.probability:.2f} < {f.t.sure:g}",
    ),
    Rule("claimed", lambda f: True, _named, lambda f: ", ".join(filter(None, [_sure(f), _all_told(f)]))),
)
"""In order: the first that holds settles the verdict."""


def decide(findings: Findings, rules: Sequence[Rule] = RULES) -> Verdict:
    """The verdict by the first rule that holds, with a posterior that does not contradict it."""
    rule = next(r for r in rules if r.holds(findings))
    said = rule.says(findings)
    return Verdict(said, _settled(findings, said), (f"{rule.name}: {rule.text(findings)}",))


def _settled(f: Findings, said: str) -> Posterior:
    """The posterior, where no effect is named: no cause has even odds then, and `unknown` is more probable outside the
    library than not."""
    p, t = f.posterior, f.t
    if said in ("effect", "several"):
        return p
    if said == "unknown":
        return p.doubted(1.0 - t.unnamed)
    most = t.unseen if p.causes and f.first.detectability < f.seen else t.unnamed
    largest = max((c.probability for c in p.causes), default=0.0)
    return p.scaled(most / max(largest, most), p.foreign)


def undetectable(verdict: Verdict, reason: str) -> Verdict:
    """The same findings where the rest is known to be the simulation's own error, for ``reason``."""
    return replace(verdict, verdict="undetectable", rules=(*verdict.rules, reason))


def in_doubt(verdict: Verdict, reason: str, t: Thresholds) -> Verdict:
    """The same findings where a reference specimen that is not as stated explains as much as the first cause, for
    ``reason``."""
    rules = (f"{DOUBT}: {reason}", *verdict.rules)
    return Verdict("unknown", verdict.posterior.doubted(1.0 - t.unnamed), rules)
