"""Limits of hardware, station, subject and protocol in every combination: a forbidden protocol is never armed."""

from __future__ import annotations

from collections.abc import Iterator

from acquire.session import Session
from acquire.station import load_station
from benchmarks.faults.table import Campaign, Part, Row
from protocols import load

FULL = 2000
#: Per instrument: its hardware's bound (written without sign), a value within it, the step and the limit's text.
SUCTION = ("suction: {value:.0f} mbar", "pressure: {{low: -{bound:.0f} mbar, high: 0 mbar{dwell}}}")
ROBOT = (
    "position: {{x: {value:.3f} mm}}, speed: 5 mm/s",
    "probe_x: {{low: -{bound:.3f} mm, high: {bound:.3f} mm}}{dwell}",
)
INSTRUMENTS = {"cutometer": (500.0, SUCTION), "aspiration": (700.0, SUCTION), "microrobot": (3.0, ROBOT)}


def rows(campaign: Campaign) -> Iterator[Row]:
    """Random set-points, durations and limits of every owner; refused exactly when one of the limits is passed."""
    row = Row(
        "limits of protocol, station, hardware, subject in every combination, time under suction included",
        "refused before arming when any is passed, taken when none is",
    )
    random = campaign.random("bounds")
    for _ in range(campaign.count(FULL)):
        kind = str(random.choice(list(INSTRUMENTS)))
        hardware, (step, limit) = INSTRUMENTS[kind]
        bound_by = [owner for owner in ("station", "subject", "protocol") if random.random() < 0.6]
        owners = {owner: float(random.uniform(0.3, 1.3)) * hardware for owner in bound_by}
        dwells = {o: float(random.uniform(5, 60)) for o in owners if random.random() < 0.5 and kind != "microrobot"}
        value, duration = float(random.uniform(0.2, 1.3)) * hardware, float(random.uniform(2, 70))
        texts = {
            o: "{" + limit.format(bound=b, dwell=f", dwell: {dwells[o]:.0f} s" if o in dwells else "") + "}"
            for o, b in owners.items()
        }
        passed = [o for o, b in {**owners, "hardware": hardware}.items() if round(value, 3) > round(b, 3)]
        # Within this much of a limit the ramps at a hold's ends decide.
        near = any(abs(value - b) < 0.02 * hardware for b in (*owners.values(), hardware))
        near |= any(abs(duration - d) < 3 for d in dwells.values())
        passed += [f"{o}'s dwell" for o, d in dwells.items() if duration > d]
        if near:
            continue
        refusal = _refusal(kind, step.format(value=value), duration, texts)
        if bool(passed) != bool(refusal):
            row.trial(problem=f"{kind} {value:.1f} for {duration:.0f} s with {texts}: {refusal or 'taken'}")
        else:
            row.trial()
    yield row


def _refusal(kind: str, step: str, duration: float, limits: dict[str, str]) -> str:
    """Why a session does not compile a hold; empty if it does."""
    own = f"limits: {limits['protocol']}\n" if "protocol" in limits else ""
    station = f", limits: {limits['station']}" if "station" in limits else ""
    subject = f"subjects: {{P07: {limits['subject']}}}\n" if "subject" in limits else ""
    bench = f"schema: station/1\ninstruments:\n  {kind}: {{simulated: true{station}}}\n{subject}"
    hold = f"- {{type: hold, {step}, duration: {duration:.1f} s}}\n"
    text = f"schema: protocol/1\nname: p\ninstrument: {kind}\n{own}steps:\n{hold}"
    try:
        with Session(load_station(bench)) as session:
            session.compile(kind, load(text), "P07")
    except ValueError as error:
        return str(error)
    return ""


CLOCKED = False
PARTS: dict[str, Part] = {"limits": rows}
