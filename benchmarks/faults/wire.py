"""Bad cables: bytes flipped, cut, lost, repeated, swapped, invented between instrument and host; cameras that stall."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from acquire.engine import State
from acquire.recording import Recording, open_recording
from benchmarks.faults.rig import STALE, WATCHDOG, Rig, Stillness
from benchmarks.faults.table import Campaign, Part, Row
from sim_devices.servers.proxy import DELIMITERS, Damage, Proxy, Wire

FULL = 100
SHARE, LASTS = 0.3, 0.3  # share of messages that are damaged, for so many s
STOPPED = 0.15  # s from noticing to the vent: a frame, two control cycles, the answer
RESYNC = 0.1  # s after the last damaged message until a sample comes
HELD, NOISE = -20e3, 3e3  # Pa: the hold, and more than its noise and its leak
DAMAGES = ("flip", "truncate", "drop", "repeat", "swap", "late", "garbage")
COUNTED = ("flip", "truncate", "garbage")  # these leave bytes that make no message; the others leave gaps or doubles


def _bytes(campaign: Campaign) -> Iterator[Row]:
    row = Row(
        "bytes flipped, cut, lost, repeated, swapped, late, invented (30 % of messages for 0.3 s)",
        f"no false sample, time never goes back, a sample again ≤ {RESYNC * 1e3:g} ms later, counted in the file",
        "s to the next sample",
        RESYNC,
    )
    proxies: dict[str, Proxy] = {}

    def between(addresses: Mapping[str, str]) -> Mapping[str, str]:
        proxies["control"] = Proxy(addresses["address"], DELIMITERS["cutometer"], campaign.seed)
        return {**addresses, "address": proxies["control"].address}

    with Rig("cutometer", seed=campaign.seed, between=between) as rig:
        wire = proxies["control"].to_host
        count = campaign.count(FULL)
        while row.trials < count:
            damage = DAMAGES[row.trials % len(DAMAGES)]
            engine = rig.begin()
            time.sleep(0.5)  # held, no longer settling
            still, began = Stillness(), time.monotonic()
            before = wire.done[damage]
            wire.damage = Damage(**{damage: SHARE})
            time.sleep(LASTS)
            wire.damage = Damage()
            ended = time.monotonic()
            time.sleep(0.25)
            state = engine.state
            waited = still.close()
            engine.abort("enough")
            outcome = rig.over(engine)
            figure, problem = float("nan"), ""
            if waited > WATCHDOG / 2 and "no heartbeat" in outcome.reason:
                continue  # vented because this computer stood still, and rightly: no trial of a cable
            if state is not State.RUNNING:
                problem = f"ended {outcome.status}: {outcome.reason}"
            elif outcome.recording is None:
                problem = "no recording"
            else:
                recording = open_recording(outcome.recording)
                figure = _resumed(recording, ended) - waited
                done = wire.done[damage] - before
                problem = _false(recording, began) or _uncounted(recording, damage, done)
            row.trial(max(0.0, figure), problem and f"{damage}: {problem}")
        for proxy in proxies.values():
            proxy.close()
    yield row


def _resumed(recording: Recording, moment: float) -> float:
    """Seconds from ``moment`` (host's clock) to the next sample."""
    host = recording.streams["pressure"].time_host
    assert host is not None
    later = host[host > moment]
    return float(later[0]) - moment if len(later) else float("inf")


def _false(recording: Recording, moment: float) -> str:
    """Faults in the recorded samples: none may lie beside the hold, none may come twice or go back."""
    series = recording.streams["pressure"]
    assert series.time_host is not None
    if (np.diff(series.time) <= 0).any():
        return "time goes back or stands still"
    held = series.value[(series.time_host > moment) & (series.time_host < moment + LASTS + 0.2)]
    wrong = held[np.abs(held - HELD) > NOISE]
    return f"{len(wrong)} false samples, such as {wrong[0]:g} Pa" if len(wrong) else ""


def _uncounted(recording: Recording, damage: str, done: int) -> str:
    codes = {event.code for event in recording.events}
    if done and damage in COUNTED and "discarded" not in codes:
        return f"{done} damaged messages, and no event tells of discarded bytes ({', '.join(sorted(codes))})"
    return ""


def _stalls(campaign: Campaign) -> Iterator[Row]:
    must = f"noticed after {STALE:g} s (the stale limit); the run stops {STOPPED:g} s later, frame numbers true"
    row = Row("camera stalls", must, "s to the vent", STALE + STOPPED)
    with _camera(campaign) as (rig, wire):
        for _ in range(campaign.count(FULL)):
            engine = rig.begin()
            time.sleep(0.3)
            still, began = Stillness(), time.monotonic()
            wire.mute = True
            stopped, problem = rig.stopped(5.0)
            waited = still.close()
            wire.mute = False
            outcome = rig.over(engine)
            if not problem and outcome.status is not State.TRIPPED:
                problem = f"ended {outcome.status}: {outcome.reason}"
            row.trial(max(0.0, stopped - began - waited), problem or _frames(outcome.recording))
    yield row


def _drops(campaign: Campaign) -> Iterator[Row]:
    must = "the run goes on; frame numbers true, their times rise, every frame that is missing is counted in the file"
    row = Row("camera drops frames (30 % for 0.5 s)", must)
    with _camera(campaign) as (rig, wire):
        for _ in range(campaign.count(FULL)):
            engine = rig.begin()
            time.sleep(0.3)
            before = wire.done["drop"]
            wire.damage = Damage(drop=SHARE)
            time.sleep(0.5)
            wire.damage = Damage()
            time.sleep(0.3)
            state = engine.state
            engine.abort("enough")
            outcome = rig.over(engine)
            problem = "" if state is State.RUNNING else f"ended {outcome.status}: {outcome.reason}"
            row.trial(problem=problem or _frames(outcome.recording, wire.done["drop"] > before))
    yield row


@contextlib.contextmanager
def _camera(campaign: Campaign) -> Iterator[tuple[Rig, Wire]]:
    """An instrument with a camera, and the camera's wire."""
    proxies: list[Proxy] = []

    def between(addresses: Mapping[str, str]) -> Mapping[str, str]:
        proxies.append(Proxy(addresses["camera"], seed=campaign.seed))
        return {**addresses, "camera": proxies[0].address}

    with Rig("aspiration", seed=campaign.seed, between=between) as rig:
        yield rig, proxies[0].to_host
    proxies[0].close()


def _frames(path: Path | None, dropped: bool = False) -> str:
    """Faults in the recorded frames, some of which were ``dropped`` on the way."""
    if path is None:
        return "no recording"
    recording = open_recording(path)
    if recording.frames is None or recording.frames.seq is None:
        return "no frames"
    steps = np.diff(recording.frames.seq)
    if (steps <= 0).any() or (np.diff(recording.frames.time) <= 0).any():
        return "frames are not in their order"
    gaps = int((steps - 1).sum())
    told = sum(event.count for event in recording.events if event.code == "lost" and "frames" in event.text)
    if gaps != told or (dropped and not gaps):
        return f"the frames' numbers leave out {gaps}, events tell of {told}"
    return ""


CLOCKED = True
PARTS: dict[str, Part] = {"bytes": _bytes, "camera-stalls": _stalls, "camera-drops": _drops}
