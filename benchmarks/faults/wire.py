"""Bad cables: bytes flipped, cut, lost, repeated, swapped, invented between instrument and host; cameras that stall."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping

import numpy as np

from acquire.engine import State
from acquire.recording import Recording, open_recording
from benchmarks.faults.rig import STALE, WATCHDOG, Rig, Stillness
from benchmarks.faults.table import Campaign, Row
from sim_devices.servers.proxy import DELIMITERS, Damage, Proxy

FULL = 100
SHARE, LASTS = 0.3, 0.3  # share of messages that are damaged, for so many s
RESYNC = 0.1  # s after the last damaged message until a sample comes
HELD, NOISE = -20e3, 3e3  # Pa: the hold, and more than its noise and its leak
DAMAGES = ("flip", "truncate", "drop", "repeat", "swap", "late", "garbage")
COUNTED = ("flip", "truncate", "garbage")  # these leave bytes that make no message; the others leave gaps or doubles


def rows(campaign: Campaign) -> Iterator[Row]:
    """A row for damaged bytes, one for cameras."""
    yield _bytes(campaign)
    yield _camera(campaign)


def _bytes(campaign: Campaign) -> Row:
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
    return row


def _resumed(recording: Recording, moment: float) -> float:
    """Seconds from ``moment`` (host's clock) to the next sample."""
    host = recording.streams["pressure"].time_host
    assert host is not None
    later = host[host > moment]
    return float(later[0]) - moment if len(later) else float("inf")


def _false(recording: Recording, moment: float) -> str:
    """What is false in the recorded samples: none may lie beside the hold, none may come twice or go back."""
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


def _camera(campaign: Campaign) -> Row:
    must = f"the run stops within {STALE:g} s (its stale limit) and 0.5 s, frame numbers true"
    row = Row("camera stalls", must, "s to the vent", STALE + 0.5)
    proxies: dict[str, Proxy] = {}

    def between(addresses: Mapping[str, str]) -> Mapping[str, str]:
        result = dict(addresses)
        for name, address in addresses.items():
            if name != "address":
                proxies[name] = Proxy(address, seed=campaign.seed)
                result[name] = proxies[name].address
        return result

    with Rig("aspiration", seed=campaign.seed, between=between) as rig:
        (camera,) = proxies.values()
        for _ in range(campaign.count(FULL)):
            engine = rig.begin()
            time.sleep(0.3)
            still, began = Stillness(), time.monotonic()
            camera.to_host.mute = True
            stopped, problem = rig.stopped(5.0)
            waited = still.close()
            camera.to_host.mute = False
            outcome = rig.over(engine)
            if not problem and outcome.status is not State.TRIPPED:
                problem = f"ended {outcome.status}: {outcome.reason}"
            if not problem and (outcome.recording is None or not _frames_true(open_recording(outcome.recording))):
                problem = "frames are not in their order"
            row.trial(max(0.0, stopped - began - waited), problem)
        camera.close()
    return row


def _frames_true(recording: Recording) -> bool:
    frames = recording.frames
    return frames is not None and frames.seq is not None and bool((np.diff(frames.seq) > 0).all())
