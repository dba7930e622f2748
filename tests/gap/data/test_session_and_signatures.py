"""Clocks and commands of a session; marks that converters leave in single samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from acquire.recording.model import SegmentRecord
from gap.data.labels import direction, level, phases
from gap.data.noise import finest_step
from gap.data.repeats import repeats_foretold
from gap.data.session import LONGEST_REST, REST, Session
from gap.data.signatures import HUM, MAINS, find, never_repeat
from gap.data.slow_noise import slow_variance

TIME = np.arange(0.0, 10.0, 0.01)
COMMAND = ([0.0, 1.0, 1.0, 6.0, 6.0, 10.0], [0.0, 0.0, -3e4, -3e4, 0.0, 0.0])


def test_recordings_on_one_clock_stay_there(recording) -> None:
    later = ([t + 30 for t in COMMAND[0]], COMMAND[1])
    session = Session(
        [
            recording({"pressure": 0 * TIME}, TIME, {"pressure": COMMAND}),
            recording({"pressure": 0 * TIME}, TIME + 30, {"pressure": later}),
        ]
    )
    assert not session.rests_assumed
    assert session.span(1)[0] == pytest.approx(30.0)


def test_recordings_whose_clocks_begin_anew_are_laid_one_after_another(recording) -> None:
    session = Session([recording({"pressure": 0 * TIME}, TIME, {"pressure": COMMAND}) for _ in range(2)])
    assert session.rests_assumed
    assert session.span(1)[0] == pytest.approx(session.span(0)[1] + REST)


def begun(recording, *started: str) -> Session:
    """Recordings of some ten seconds, whose clocks begin anew, by when they were started."""
    made = [recording({"pressure": 0 * TIME}, TIME, {"pressure": COMMAND}) for _ in started]
    return Session([replace(r, info=replace(r.info, start_time=t)) for r, t in zip(made, started, strict=True)])


def test_rests_are_those_between_the_times_at_which_recordings_began(recording) -> None:
    noon = "2026-03-01T12:00:00+01:00"
    session = begun(recording, noon, "2026-03-01T12:02:00+01:00", "2026-03-01T11:02:30+00:00")
    assert not session.rests_assumed
    assert [session.span(k)[0] for k in range(3)] == pytest.approx([0.0, 120.0, 150.0])
    assert begun(recording, noon, "2026-03-04T12:00:00+01:00").span(1)[0] == pytest.approx(LONGEST_REST + TIME[-1])


@pytest.mark.parametrize("second", ["", "at noon", "2026-03-01T12:02:00", "2026-03-01T12:00:02+01:00"])
def test_rests_are_assumed_where_the_times_do_not_say(recording, second: str) -> None:
    """No time, none that can be read or compared, or one during the recording before (a simulation ran faster)."""
    session = begun(recording, "2026-03-01T12:00:00+01:00", second)
    assert session.rests_assumed
    assert session.span(1)[0] == pytest.approx(session.span(0)[1] + REST)


def test_a_clock_is_as_old_as_its_recording_or_as_the_session(recording) -> None:
    later = ([t + 30 for t in COMMAND[0]], COMMAND[1])
    made = [recording({"pressure": 0 * T}, T, {"pressure": c}) for T, c in ((TIME, COMMAND), (TIME + 30, later))]
    at = np.array([0.0, 4.0, 29.99, 31.0])
    assert Session(made).clock_age(at) == pytest.approx(at)
    own = Session([made[0], made[0]])
    begin = own.span(1)[0]
    assert own.clock_age(np.array([4.0, begin - 0.01, begin + 2.5])) == pytest.approx([4.0, -0.01, 2.5])


def test_a_command_is_at_rest_between_recordings(recording) -> None:
    held = ([0.0, 1.0, 1.0, 10.0], [0.0, 0.0, -3e4, -3e4])
    session = Session([recording({"pressure": 0 * TIME}, TIME, {"pressure": held}) for _ in range(2)])
    command = session.command("pressure", (0, 1))
    between = session.span(0)[1] + REST / 2
    assert np.interp(between, command.time, command.value) == pytest.approx(0.0, abs=1e-9)
    assert np.interp(5.0, command.time, command.value) == pytest.approx(-3e4)


def test_a_sampled_command_keeps_its_corners_and_steps(recording) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    ramp = np.interp(t, [0, 2, 4, 10], [0, 0, -2e4, -2e4])
    step = np.where(t >= 8.0, 0.0, ramp)
    command = Session([recording({"pressure": step}, t, {"pressure": (t, step)})]).command("pressure", (0,))
    assert len(command.time) < 20
    assert np.interp(3.0, command.time, command.value) == pytest.approx(-1e4, rel=1e-3)
    drop = np.flatnonzero(np.diff(command.value) > 1e4)
    assert len(drop) == 1
    assert command.time[drop[0] + 1] == pytest.approx(8.0, abs=0.011)


def test_labels_of_rows(recording) -> None:
    r = recording({"pressure": 0 * TIME}, TIME, {"pressure": COMMAND})
    assert level(r) == "300 mbar"
    assert phases(r, np.array([0.5, 1.1, 4.0, 6.2, 9.0])) == ["rest", "load", "hold", "unload", "rest"]
    tip = {f"probe_{a}": ([0.0, 1.0], [0.0, 1e-3 * v]) for a, v in zip("xyz", (0.0, 1.0, 0.0), strict=True)}
    assert direction(recording({"force_x": 0 * TIME}, TIME, tip)) == "90°"
    assert direction(r) == "-"
    assert set(phases(recording({"pressure": 0 * TIME}, TIME), TIME)) == {"all"}


def made(recording, value: np.ndarray, **fields):
    r = recording({"apex_height": value}, TIME)
    return replace(r, streams={"apex_height": replace(r.streams["apex_height"], **fields)})


def wave() -> np.ndarray:
    return 1e-3 * np.sin(TIME) + 3e-6 * np.random.default_rng(5).normal(size=len(TIME))


def test_a_sound_channel_has_no_signature(recording) -> None:
    assert find([made(recording, wave())]) == []
    assert find([made(recording, np.round(wave() / 1e-6) * 1e-6)]) == []


@pytest.mark.parametrize(("sign", "effect"), [(1, "saturation"), (-1, "lower_saturation")])
def test_a_clipped_channel_is_told(recording, sign: int, effect: str) -> None:
    found = find([made(recording, sign * np.minimum(wave(), 0.7e-3))])
    assert [(s.effect, s.channel) for s in found] == [(effect, "apex_height")]
    assert "apex_height stands at" in found[0].text


@pytest.mark.parametrize("top", [2.0, 9.0])
def test_what_creeps_up_to_its_end_under_noise_is_clipped_there(recording, top: float) -> None:
    """Noise takes it below again and again: no run of samples at the end is entered with a slope."""
    t = np.arange(0.0, 20.0, 0.02)
    value = 1.5 * t**0.1 + 0.02 * np.random.default_rng(3).normal(size=len(t))
    marks = {s.effect for s in find([recording({"apex_height": np.minimum(value, top)}, t)])}
    assert ("saturation" in marks) == (top < value.max())


def test_a_repeated_value_would_show_where_noise_is_finer_than_the_grid(recording) -> None:
    t = np.arange(0.0, 20.0, 0.02)
    rng = np.random.default_rng(5)
    fine = np.round(np.sin(t) + 0.02 * rng.normal(size=len(t)), 4)
    lost = np.where(rng.random(len(t)) < 0.02, np.roll(fine, 1), fine)
    assert never_repeat([recording({"pressure": fine}, t)])
    assert not never_repeat([recording({"pressure": lost}, t)])
    assert not never_repeat(
        [recording({"pressure": fine, "apex_height": np.round(fine, 1)}, t)]
    )  # it could not be seen


def test_a_slow_signal_on_a_coarse_grid_is_not_clipped(recording) -> None:
    slow = 1e-3 * (1 - np.exp(-TIME / 3))
    found = find([made(recording, np.round(slow / 2e-5) * 2e-5)])
    assert [s.effect for s in found] == ["sensor_quantisation"]  # but it is twice as coarse as the instrument
    assert find([made(recording, np.round(slow / 1e-5) * 1e-5)]) == []
    still = [made(recording, np.full(len(TIME), k * 1e-4)) for k in range(3)]  # each at a level of its own
    assert [s for s in find(still) if s.effect == "sensor_quantisation"] == []


@pytest.mark.parametrize(("wider", "told"), [(0.35, True), (0.0, False)])
def test_steps_of_two_sizes_are_told_however_fine(recording, wider: float, told: bool) -> None:
    """Levels 5 and 11 µm apart were no finding, as the instrument's resolution is 10 µm (uneven steps, six cases)."""
    cell = np.floor(0.3 * wave() / 8e-6)
    found = find([made(recording, np.round(8e-6 * (cell + wider * (cell % 2)), 9))])
    assert [s.effect for s in found] == ["sensor_quantisation"] * told
    assert all("uneven steps" in s.text and s.noise > 1.2 for s in found)


def test_skipped_levels_rounded_digits_and_a_bent_scale_are_no_uneven_steps(recording) -> None:
    even = np.round(0.1 * wave() / 3.3e-6)
    assert find([made(recording, 3.3e-6 * np.where(even % 7 == 3, even + 1, even))]) == []
    assert find([made(recording, np.round(3.3e-6 * even, 7))]) == []
    assert find([made(recording, 3.3e-6 * even * (1.0 + 2e-4 * even))]) == []


def test_marks_count_only_on_the_channels_asked_for(recording) -> None:
    stepped = np.where(TIME % 2 < 1, 0.0, 1.0) + np.where(TIME % 3 < 1, 0.5, 0.0)
    r = recording({"apex_height": np.minimum(wave(), 0.7e-3), "voltage": np.minimum(wave(), 0.5e-3)}, TIME)
    r = replace(r, streams={**r.streams, "command": replace(r.streams["voltage"], value=stepped)})
    assert {s.channel for s in find([r])} >= {"apex_height", "voltage"}
    assert [(s.effect, s.channel) for s in find([r], ("apex_height",))] == [("saturation", "apex_height")]


def test_repeated_samples_are_told(recording) -> None:
    value = wave()
    again = np.random.default_rng(1).choice(np.arange(1, len(value)), 60, replace=False)
    for k in sorted(again):
        value[k] = value[k - 1]
    found = find([made(recording, value)])
    assert [s.effect for s in found] == ["dropped_samples"]
    assert found[0].also == ("late_samples",)  # an old value under a new stamp is the same mark


def test_gaps_in_numbers_or_stamps_are_told(recording) -> None:
    seq = np.arange(len(TIME))
    seq[500:] += 3
    assert [s.effect for s in find([made(recording, wave(), seq=seq)])] == ["dropped_samples"]
    keep = np.r_[0:400, 404:1000]
    r = recording({"apex_height": wave()[keep]}, TIME[keep])
    assert [s.effect for s in find([r])] == ["dropped_samples"]


def test_a_constant_or_short_channel_says_nothing(recording) -> None:
    assert find([made(recording, np.zeros(len(TIME)))]) == []
    assert find([recording({"apex_height": np.zeros(5)}, TIME[:5])]) == []


@pytest.mark.parametrize("rate", [25.0, 100.0])
def test_a_hum_in_the_noise_is_found_and_noise_or_a_step_is_none(recording, rate: float) -> None:
    rng = np.random.default_rng(0)
    sessions: dict[bool, list] = {True: [], False: []}
    for k in range(4):
        time = np.arange(0.0, 30.0, 1 / rate) + 60 * k
        clean = np.where(time - 60 * k > 5, -3e4, 0.0) + 100.0 * rng.normal(size=len(time))
        for humming, made in sessions.items():
            value = clean + humming * 100.0 * np.sin(2 * np.pi * 0.31 * rate * time)
            made.append(recording({"pressure": np.round(value, -2)}, time, {"pressure": COMMAND}))
    (mark,) = [m for m in find(sessions[True]) if m.effect == HUM]
    assert f"{0.31 * rate:.1f} Hz" in mark.text
    assert not [m for m in find(sessions[False]) if m.effect == HUM]


@pytest.mark.parametrize(
    ("lines", "marks"),
    [
        ((50.02,), (MAINS,)),
        ((59.95,), (MAINS,)),
        ((53.0,), (HUM,)),
        ((50.0, 71.0), (HUM, MAINS)),
        ((50.0, 100.0, 150.0), (MAINS,)),
        ((60.0, 70.0), (MAINS,)),
        ((80.0,), (HUM,)),
        ((), ()),
    ],
)
def test_a_line_of_the_mains_is_known_from_any_other(recording, lines: tuple, marks: tuple) -> None:
    rng, session = np.random.default_rng(2), []
    for k in range(3):
        time = np.arange(0.0, 20.0, 1 / 250.0) + 30 * k
        force = 0.003 * (rng.normal(size=len(time)) + sum(0.35 * np.sin(2 * np.pi * f * time) for f in lines))
        session.append(recording({"pressure": force}, time, {"pressure": COMMAND}))
    assert [m.effect for m in find(session)] == list(marks)


@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_edges_that_come_back_with_every_cycle_are_no_hum(recording, rate: float) -> None:
    """Steps through two lags of 40 ms, sampled so slowly that fourth differences do not take them out: their comb has
    lines. A line that one recording of several has is none of the mains."""
    rng = np.random.default_rng(1)
    session = []
    for k, period in enumerate((6.0, 6.0, 60.0, 60.0)):
        time = np.arange(0.0, 60.0, 1 / rate)
        since = np.mod(time, period / 2)
        risen = 1 - (1 + since / 0.04) * np.exp(-since / 0.04)
        value = -3e4 * np.where(np.mod(time, period) < period / 2, risen, 1 - risen) + 60.0 * rng.normal(size=len(time))
        session.append(recording({"pressure": np.round(value, -1)}, time + 90 * k, {"pressure": COMMAND}))
    assert not [m for m in find(session) if m.effect == HUM]


def test_stamps_that_come_in_blocks_or_not_at_all_are_no_fault_of_the_search_for_a_hum(recording) -> None:
    noise = np.random.default_rng(0).normal(size=400)
    for time in (np.repeat(np.arange(0.0, 4.0, 0.1), 10), np.zeros(400)):
        assert not [m for m in find([recording({"pressure": noise}, time, {})]) if m.effect == HUM]


def fine_force(recording, seed: int, lost: float = 0.0):
    """A transducer on a grid of 10 µN under 3 mN of noise, a share of whose samples repeats the last."""
    time, rng = np.arange(0.0, 60.0, 0.01), np.random.default_rng(seed)
    value = np.round((0.5 * np.sin(0.6 * time) + 3e-3 * rng.normal(size=len(time))) / 1e-5) * 1e-5
    for k in np.flatnonzero(rng.random(len(time)) < lost)[1:]:
        value[k] = value[k - 1]
    return recording({"transducer_force_a": value}, time)


def test_noise_on_a_fine_grid_repeats_as_often_as_it_should(recording) -> None:
    """Three hundred steps to the noise: some samples of thousands are equal by chance."""
    assert find([fine_force(recording, k) for k in range(6)]) == []
    (mark,) = find([fine_force(recording, 1, 0.02)])
    assert (mark.effect, mark.nats) == ("dropped_samples", 30.0)


@pytest.mark.parametrize("step", [1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
def test_repeats_are_foretold_from_the_changes_whatever_the_grid(step: float) -> None:
    rng = np.random.default_rng(1)
    value = np.round(3e-3 * rng.normal(size=40000) / step)
    change = np.diff(value)
    foretold = repeats_foretold(change * step, finest_step(value * step))
    assert foretold == pytest.approx(np.sum(change == 0), abs=5 * np.sqrt(np.sum(change == 0) + 1) + 2)


def test_a_servo_that_rests_short_of_its_set_points_is_not_clipped(recording) -> None:
    places, rng = np.array([0.0, 0.0102, 0.0051, 0.0148, 0.0099, 0.0148]), np.random.default_rng(0)
    goal = np.repeat(places, len(TIME) // len(places) + 1)[: len(TIME)]
    way = np.zeros(len(TIME))
    for k in range(1, len(way)):
        way[k] = way[k - 1] + 0.3 * (goal[k] - way[k - 1])
    encoder = np.round(way / 1e-6) * 1e-6
    assert [s.effect for s in find([recording({"position": encoder}, TIME)], ("position",))] == []
    noisy = np.minimum(way + 1e-5 * rng.normal(size=len(way)), 0.0125)
    assert [s.effect for s in find([recording({"position": noisy}, TIME)], ("position",))] == ["saturation"]


def test_phases_are_the_recorded_segments_where_there_are_any(recording) -> None:
    r = recording({"pressure": 0 * TIME}, TIME, {"pressure": COMMAND})
    ends, names = (1.0, 1.001, 6.0, 6.001, 10.0), ("rest", "load", "hold", "unload", "rest")
    still = {"pressure": 0.0}
    segments = tuple(
        SegmentRecord(begin, end, phase, "0", still, still)
        for begin, end, phase in zip((0.0, *ends), ends, names, strict=False)
    )
    asked = np.array([0.5, 1.1, 4.0, 6.2, 9.0])
    expected = ["rest", "load", "hold", "unload", "rest"]
    assert phases(replace(r, segments=segments), asked) == phases(r, asked) == expected
    renamed = tuple(replace(s, phase="hold") for s in segments)
    assert set(phases(replace(r, segments=renamed), asked)) == {"hold"}


def test_rows_in_which_all_channels_repeat_are_told(recording) -> None:
    """Each channel by itself repeats on its grid now and then; all at once they do where an old sample is written."""
    rng = np.random.default_rng(2)
    t = np.arange(6000) * 0.005
    names = [*(f"axis_position_{k}" for k in (1, 2, 3)), *(f"transducer_force_{k}" for k in "abc")]
    values = {n: np.round(np.sin(0.3 * t + k) * 500 + rng.normal(0, 3.0, len(t))) for k, n in enumerate(names)}
    sound = find([recording(values, t, instrument="microrobot")])
    assert not any(s.certain for s in sound)
    lost = np.sort(rng.choice(np.arange(1, 6000), 60, replace=False))
    for v in values.values():
        v[lost] = v[lost - 1]
    marks = [s for s in find([recording(values, t, instrument="microrobot")]) if s.certain]
    assert [(s.effect, s.also) for s in marks] == [("dropped_samples", ("late_samples",))]
    times, expected = (float(part.split()[0]) for part in marks[0].text.split("last values ")[1].split(" times where "))
    assert times > 50 > 1e3 * expected


def suction_on_a_grid(recording, seed: int, change=None):
    """Pressure and height in steps of half their noise, 50 Hz, on triangles; ``change`` puts older rows in."""
    time, rng = np.arange(0.0, 60.0, 0.02), np.random.default_rng(seed)
    path = np.abs((time / 5.0) % 2.0 - 1.0)
    rows = np.column_stack([-2e4 * path + 60.0 * rng.normal(size=len(time)), path + 3e-3 * rng.normal(size=len(time))])
    rows = np.round(rows / [30.0, 1.5e-3]) * [30.0, 1.5e-3]
    if change is not None:
        rows = rows[change(np.arange(len(time)), rng)]
    return recording({"pressure": rows[:, 0], "apex_height": 1e-3 * rows[:, 1]}, time)


def late_bursts(row: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    for begin in rng.integers(50, len(row) - 50, 6):
        row[begin : begin + 6] -= 4
    return row


def lost_runs(row: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    for begin in rng.integers(50, len(row) - 50, 12):
        row[begin : begin + 14] = row[begin]
    return row


@pytest.mark.parametrize("seed", range(4))
def test_late_samples_are_copies_of_older_ones(recording, seed: int) -> None:
    assert not [s for s in find([suction_on_a_grid(recording, seed)]) if s.certain]
    marks = [s for s in find([suction_on_a_grid(recording, seed, late_bursts)]) if s.certain]
    assert [s.effect for s in marks] == ["late_samples"]


@pytest.mark.parametrize("seed", range(4))
def test_lost_samples_hold_a_value_and_jump(recording, seed: int) -> None:
    marks = [s.effect for s in find([suction_on_a_grid(recording, seed, lost_runs)]) if s.certain]
    assert marks
    assert set(marks) == {"dropped_samples"}


def test_a_quiet_channel_that_steps_holds_no_old_value(recording) -> None:
    """At rest a coarse channel stands still by itself, and steps with its command."""
    rng = np.random.default_rng(3)
    level = -1e3 * np.repeat(rng.integers(0, 20, 30), 100) + 20.0 * rng.normal(size=3000)
    stepping = recording({"pressure": np.round(level / 100.0) * 100.0}, 0.01 * np.arange(3000))
    assert not [s for s in find([stepping]) if s.certain]


def test_few_digits_are_no_coarse_channel(recording) -> None:
    """Steps up to twice the noise add their square over twelve to it, and no more."""
    rng = np.random.default_rng(4)
    value = -1e4 * np.abs(np.sin(0.3 * np.arange(4000) * 0.02)) + 40.0 * rng.normal(size=4000)
    for step, told in ((50.0, False), (300.0, True)):
        series = recording({"pressure": np.round(value / step) * step}, np.arange(4000) * 0.02)
        assert bool([s for s in find([series]) if s.effect == "sensor_quantisation"]) == told


def test_a_short_recordings_slow_noise_is_told_by_the_others(recording) -> None:
    """A few s on a rigid block are too few to tell it, and had been told a drift of the light (.93)."""
    rng = np.random.default_rng(3)
    made = []
    for k, (length, name) in enumerate([(6.0, "rigid block"), (90.0, "skin"), (90.0, "skin")]):
        time = 200.0 * k + np.arange(0.0, length, 0.02)
        slow = lfilter([np.sqrt(1 - 0.98**2)], [1, -0.98], rng.normal(size=len(time)))
        value = 5e-6 * rng.normal(size=len(time)) + 1.5e-6 * slow
        table = (200.0 * k + np.array([0.0, length]), np.zeros(2))
        made.append(recording({"apex_height": value}, time, {"pressure": table}, specimen=name, name=f"r{k}"))
    session = Session(made)
    short = slow_variance(session._runs("apex_height", [0]), np.zeros(0), 5e-6)
    assert short == 0.0
    assert session.sigma("apex_height", [0], np.zeros(0)).slow == pytest.approx(1.5e-6, rel=0.5)
