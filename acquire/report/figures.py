"""Figures of a recording: curves over time, loops, images. Matplotlib is imported at the first use."""

from __future__ import annotations

import base64
import functools
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from acquire.analysis.cycles import onset, suction_cycles
from acquire.analysis.frames import contour_of
from acquire.analysis.loops import by_direction, loops
from acquire.analysis.statistics import mean_curve
from acquire.files import write_figure
from acquire.recording.model import FloatArray, Recording, Series
from acquire.recording.review import left_out
from acquire.words import pleasant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")
T = TypeVar("T")

POINTS = 1500  # a curve is drawn by the extremes of at most so many stretches
FAINT = "#9aa5ae"  # of runs that do not count
MEASURED, COMMANDED, SHADE = "#1f5f8b", "#d9822b", "#eef3f7"
_STYLE: dict[Any, Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.edgecolor": "#7f8c8d",
    "axes.labelcolor": "#2c3e50",
    "grid.color": "#e3e7ea",
    "font.size": 9.5,
}
COLOURS = ("#1f5f8b", "#c0392b", "#3a8f5c", "#8e5ba6", "#d9822b", "#5d6d7e")


def _styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Draws in this module's style without changing anybody else's."""

    @functools.wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> T:
        import matplotlib as mpl

        with mpl.rc_context(_STYLE):
            return draw(*args, **kwargs)

    return wrapped


@_styled
def overview(recording: Recording) -> Figure:
    """One figure of the whole recording: channels over time, and beside them loops or images."""
    beside = _beside(recording)
    groups = _groups(recording.streams)
    figure = _figure(11.0, max(4.4 if beside == "frames" else 3.2, 2.1 * len(groups) + 0.6))
    columns = 2 if beside else 1
    grid = figure.add_gridspec(max(len(groups), 1), columns, width_ratios=(2.2, 1) if beside else (1,))
    first = None
    for row, (unit, names) in enumerate(groups):
        axes = figure.add_subplot(grid[row, 0], sharex=first)
        first = first or axes
        _over_time(axes, recording, names, unit)
        axes.tick_params(labelbottom=row == len(groups) - 1)
    if first is not None:
        figure.axes[len(groups) - 1].set_xlabel("time (s)")
    if beside == "loops":
        _draw_loops(figure.add_subplot(grid[:, 1]), recording)
    elif beside == "frames":
        _draw_frame(figure.add_subplot(grid[:, 1]), recording)
    elif beside == "hysteresis":
        _draw_hysteresis(figure.add_subplot(grid[:, 1]), recording)
    return figure


@_styled
def frame_strip(recording: Recording, count: int = 4) -> Figure | None:
    """Up to ``count`` camera frames from first to highest apex with their contour; None without at least two."""
    if recording.frames is None or len(recording.frames.time) < 2:
        return None
    frames = recording.frames
    last = len(frames.time) - 1
    if "apex_height" in recording.streams:
        heights = np.nan_to_num(np.interp(frames.time, *_xy(recording.streams["apex_height"])))
        last = max(int(np.argmax(heights)), 1)
    picks = np.unique(np.linspace(0, last, count).astype(int))
    height, width = frames.data.shape[1:]
    figure = _figure(11.0, min(11.0 / len(picks) * height / width + 0.5, 6.0))
    for axes, index in zip(figure.subplots(1, len(picks), squeeze=False)[0], picks, strict=True):
        _image(axes, recording, int(index))
    return figure


def _mean_of(axes: Any, curves: Sequence[tuple[FloatArray, FloatArray]], factor: float) -> None:
    """The mean of three curves or more with its 95 % band, where they overlap."""
    if len(curves) < 3 or max(t[0] for t, _ in curves) >= min(t[-1] for t, _ in curves):
        return
    mean = mean_curve(curves)
    axes.plot(mean.time, factor * mean.mean, color="black", lw=1.6, label=f"mean of {mean.count}, 95 % band")
    low, high = mean.mean - mean.half_width, mean.mean + mean.half_width
    axes.fill_between(mean.time, factor * low, factor * high, color="black", alpha=0.15, lw=0)


@_styled
def comparison(recordings: Sequence[Recording]) -> Figure:
    """The default stream of several recordings from where each experiment begins; of three or more also their mean.

    Runs that are left out (`acquire.recording.review`) are faint and dashed, and not in the mean and its band.
    """
    figure = _figure(11.0, 3.6)
    axes = figure.subplots()
    name = recordings[0].default_plot
    factor, unit = pleasant(recordings[0].streams[name].unit)
    shown = [recording for recording in recordings if name in recording.streams]
    curves = [(r.streams[name].time - onset(r), r.streams[name].value) for r in shown]
    for number, (recording, curve) in enumerate(zip(shown, curves, strict=True)):
        time, value = thinned(*curve)
        out = bool(left_out(recording))
        facts = f"repeat {recording.info.repeat}{', left out' if out else ''}"
        label = f"{recording.info.id} ({facts})" if len(shown) <= 8 else None
        style: dict[str, Any] = {"color": FAINT, "ls": "--"} if out else {"color": COLOURS[number % len(COLOURS)]}
        axes.plot(time, factor * value, lw=1, label=label, **style)
    _mean_of(axes, [curve for r, curve in zip(shown, curves, strict=True) if not left_out(r)], factor)
    axes.set_xlabel("time from the first motion (s)")
    axes.set_ylabel(f"{_title(name)} ({unit})" if unit else _title(name))
    if len(axes.lines) <= 10:
        axes.legend(frameon=False, fontsize=8, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    return figure


def as_image(figure: Figure) -> str:
    """The figure as an SVG data URI for an HTML page."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "skinrig"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def save(figure: Figure, path: Path) -> Path:
    """Write the figure to ``path`` in the format its suffix names. Raises as `write_figure`."""
    return write_figure(figure, path, dpi=130)


def thinned(time: FloatArray, value: FloatArray, points: int = POINTS) -> tuple[FloatArray, FloatArray]:
    """The curve by the least and greatest value of each of ``points`` stretches: nothing that shows is lost."""
    count = len(value)
    if count <= 2 * points:
        return time, value
    edges = np.linspace(0, count, points + 1).astype(int)[:-1]
    filled = np.nan_to_num(value, nan=np.nanmedian(value))
    low = edges + _argument_within(filled, edges, np.argmin)
    high = edges + _argument_within(filled, edges, np.argmax)
    keep = np.unique(np.concatenate([[0], low, high, [count - 1]]))
    return time[keep], value[keep]


def _argument_within(value: FloatArray, edges: Any, which: Any) -> Any:
    ends = np.append(edges[1:], len(value))
    return np.array([which(value[a:b]) for a, b in zip(edges, ends, strict=True)])


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _beside(recording: Recording) -> str:
    if loops(recording):
        return "loops"
    if recording.frames is not None and len(recording.frames.time):
        return "frames"
    if {"pressure", "apex_height"} <= set(recording.streams) and suction_cycles(recording):
        return "hysteresis"
    return ""


def _groups(streams: Mapping[str, Series]) -> list[tuple[str, list[str]]]:
    """Channels that share a panel: components of one quantity (``force_x``, ``force_y``), each with its unit."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, series in streams.items():
        stem = name.rsplit("_", 1)[0] if name.rsplit("_", 1)[-1] in (*"123abcxyz",) else name
        groups.setdefault((series.unit, stem), []).append(name)
    return [(unit, names) for (unit, _), names in groups.items()]


def _measured(axes: Any, series: Series, factor: float, name: str, number: int | None) -> None:
    """A measured channel as a line, few samples as points; without a ``number`` it is the only one of its panel."""
    time, value = thinned(*_xy(series))
    colour, label = (MEASURED, "measured") if number is None else (COLOURS[number % len(COLOURS)], name)
    axes.plot(time, factor * value, marker="o" if len(time) < 20 else None, color=colour, lw=1.3, label=label)


def _trips(axes: Any, recording: Recording) -> None:
    """A line at each error and trip."""
    for event in recording.events:
        if event.level in ("error", "trip"):
            axes.axvline(event.time, color="#c0392b", lw=1)


def _over_time(axes: Any, recording: Recording, names: list[str], unit: str) -> None:
    """One panel: measured channels as lines, set-points dashed, suction shaded, the apex's band, trips."""
    factor, label = pleasant(unit)
    single = len(names) == 1
    for cycle in suction_cycles(recording)[:40]:
        axes.axvspan(cycle.onset, cycle.release + cycle.fall, color=SHADE, linewidth=0)
    for number, name in enumerate(names):
        _measured(axes, recording.streams[name], factor, name, None if single else number)
        commanded = recording.setpoints.get(name)
        if commanded is not None and commanded.unit == unit:
            time, value = thinned(*_xy(commanded))
            axes.plot(time, factor * value, color=COMMANDED, lw=1, ls="--", label="commanded" if number == 0 else None)
    if {"apex_low", "apex_high"} <= set(recording.derived) and names == ["apex_height"]:
        low, high = recording.derived["apex_low"], recording.derived["apex_high"]
        axes.fill_between(low.time, factor * low.value, factor * high.value, color=MEASURED, alpha=0.18, lw=0)
    title = _title(names[0] if single else names[0].rsplit("_", 1)[0])
    axes.set_ylabel(f"{title}\n({label})" if label else title)
    if len(axes.lines) > 1:
        axes.legend(frameon=False, fontsize=8, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 0.97), borderpad=0)
    _trips(axes, recording)


def _draw_loops(axes: Any, recording: Recording) -> None:
    for number, (direction, group) in enumerate(by_direction(loops(recording)).items()):
        colour = COLOURS[number % len(COLOURS)]
        x, y, z = direction
        angle = round(np.degrees(np.arctan2(y, x))) % 360 if abs(z) < 0.99 else 0
        label = (
            "normal"
            if abs(z) > 0.99
            else f"θ {angle}°" + (f", φ {round(np.degrees(np.arcsin(z)))}°" if abs(z) > 0.01 else "")
        )
        for loop in group:
            axes.plot(
                1e3 * loop.displacement, loop.force, color=colour, lw=0.9, label=label if loop is group[-1] else None
            )
    axes.set_xlabel("probe along its direction (mm)")
    axes.set_ylabel("force to hold it (N)")
    axes.legend(frameon=False, fontsize=8)


def _draw_hysteresis(axes: Any, recording: Recording) -> None:
    pressure, height = recording.streams["pressure"], recording.streams["apex_height"]
    for number, cycle in enumerate(suction_cycles(recording)):
        inside = (height.time >= cycle.onset) & (height.time <= cycle.end)
        suction = -0.01 * np.interp(height.time[inside], pressure.time, pressure.value)
        axes.plot(suction, 1e3 * height.value[inside], color=COLOURS[number % len(COLOURS)], lw=1)
    axes.set_xlabel("suction (mbar)")
    axes.set_ylabel("apex height (mm)")


def _draw_frame(axes: Any, recording: Recording) -> None:
    assert recording.frames is not None
    index = len(recording.frames.time) // 2
    if "apex_height" in recording.streams:
        heights = np.interp(recording.frames.time, *_xy(recording.streams["apex_height"]))
        index = int(np.argmax(np.nan_to_num(heights)))
    _image(axes, recording, index)


def _image(axes: Any, recording: Recording, index: int) -> None:
    frames = recording.frames
    assert frames is not None
    axes.imshow(frames.data[index], cmap="gray", vmin=0, vmax=255)
    contour = contour_of(recording, index)
    if contour is not None:
        axes.plot(*contour.outline().T, color="#2ecc71", lw=1.2)
        axes.plot(contour.apex_column, contour.apex_row, "+", color="#e74c3c", ms=9)
    axes.set_title(f"frame {index}, {frames.time[index]:.2f} s", fontsize=9)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)


def _xy(series: Series) -> tuple[FloatArray, FloatArray]:
    return series.time, series.value


def _title(name: str) -> str:
    return name.replace("_", " ")
