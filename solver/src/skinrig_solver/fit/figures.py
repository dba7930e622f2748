"""Pictures of a fit: curves with residuals, correlations, profiles. As PNG data addresses."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import units
from .result import Curve, FitResult
from .statistics import CONFIDENCE, Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .posterior import Posterior

DATA, MODEL, SHADE, GRID = "#9db4c6", "#c0392b", "#5d6d7e", "#e3e7ea"
STYLE: dict[Any, Any] = {
    "font.size": 9.5, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": GRID,
    "axes.edgecolor": "#7f8c8d", "axes.labelcolor": "#2c3e50", "legend.frameon": False, "svg.fonttype": "none",
}  # fmt: skip
SHOWN = {
    "apex_height": (1e3, "apex height, mm"),
    "deflection": (1e3, "deflection, mm"),
    "pressure": (1e-2, "pressure, mbar"),
}
POINTS = 3000  # a curve of more samples is drawn by every so many-th


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches, independent of any window system."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def as_image(figure: Figure) -> str:
    """The figure as an address that holds all of it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, bbox_inches="tight")
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _axis(name: str) -> tuple[float, str]:
    kind, _, component = name.partition("_")
    if kind == "force":
        return 1.0, f"force {component}, N"
    if kind == "probe":
        return 1e3, f"probe {component}, mm"
    return SHOWN.get(name, (1.0, name))


def curves(result: FitResult, label: str) -> Figure:
    """One recording: its drive, then each channel measured and fitted with the residual below."""
    own = [c for c in result.curves if c.label == label]
    drive = result.drives[label]
    figure = new_figure(10.4, 1.5 + 4.4 * len(own))
    axes = figure.subplots(
        1 + 2 * len(own), 1, sharex=True, height_ratios=[1.0, *(x for _ in own for x in (2.4, 2.4))], squeeze=False
    )[:, 0]
    step = -(-own[0].time.size // POINTS)
    for name, values in drive.items():
        factor, word = _axis(name)
        axes[0].plot(own[0].time[::step], factor * values[::step], lw=1.1, label=word.split(",")[0])
    axes[0].set_ylabel("probe, mm" if len(drive) > 1 else word)
    if len(drive) > 1:
        axes[0].legend(ncols=len(drive), fontsize=8, loc="upper right")
    for k, curve in enumerate(own):
        if result.posterior is not None:
            band = result.posterior.bands[result.curves.index(curve)]
            _band(axes[1 + 2 * k], curve, band, step)
        _compare(axes[1 + 2 * k], axes[2 + 2 * k], curve, step)
    axes[-1].set_xlabel("time, s")
    return figure


def _fitted(curve: Curve) -> str:
    return f"fitted, VAF {100 * curve.vaf:.2f} %" if np.isfinite(curve.vaf) else "fitted"


def _band(axis: Any, curve: Curve, band: NDArray[np.float64], step: int) -> None:
    factor, _ = _axis(curve.channel)
    low, high = factor * band[0, ::step], factor * band[2, ::step]
    axis.fill_between(curve.time[::step], low, high, color=MODEL, alpha=0.15, lw=0, label="95 % of the predictive")


def _compare(above: Any, below: Any, curve: Curve, step: int) -> None:
    factor, word = _axis(curve.channel)
    time = curve.time[::step]
    above.plot(time, factor * curve.data[::step], color=DATA, lw=2.6, label="measured")
    above.plot(time, factor * curve.model[::step], color=MODEL, lw=1.1, label=_fitted(curve))
    above.set_ylabel(word)
    above.legend(fontsize=8, loc="best")
    below.axhspan(-2 * factor * curve.noise, 2 * factor * curve.noise, color=GRID, lw=0)
    below.plot(time, factor * curve.residual[::step], color=SHADE, lw=0.7)
    below.set_ylabel(f"residual,{word.partition(',')[2]}")
    idle = curve.weight[::step] == 0.0
    if idle.any():
        for axis in (above, below):
            axis.fill_between(time, 0, 1, where=idle, transform=axis.get_xaxis_transform(), color=GRID, alpha=0.6, lw=0)


def pairs(found: Posterior) -> Figure:
    """The draws: each parameter's density, and each pair's cloud."""
    count = len(found.marginals)
    size = 1.7 * count + 0.6
    figure = new_figure(size, size)
    axes: Any = figure.subplots(count, count, squeeze=False)
    scaled = [units.readable(m.quantiles[2], m.unit) for m in found.marginals]
    for i, j in np.ndindex(count, count):
        axis = axes[i, j]
        across = found.draws[:, j] / scaled[j][1]
        axis.grid(False)
        if j > i:
            axis.set_visible(False)
        elif i == j:
            axis.hist(across, bins=40, color=DATA)
            axis.axvline(found.marginals[i].laplace_value / scaled[i][1], color=MODEL, lw=0.9)
            axis.set_yticks([])
        else:
            axis.plot(across, found.draws[:, i] / scaled[i][1], ".", ms=1.2, alpha=0.35, color=SHADE)
        axis.tick_params(labelsize=7, labelbottom=i == count - 1, labelleft=j == 0 and i > 0)
        if i == count - 1:
            axis.set_xlabel(_with_unit(found.marginals[j].free.symbol, scaled[j][0]), fontsize=8)
        if j == 0 and i > 0:
            axis.set_ylabel(_with_unit(found.marginals[i].free.symbol, scaled[i][0]), fontsize=8)
    return figure


def _with_unit(symbol: str, unit: str) -> str:
    return f"{symbol}, {unit}" if unit else symbol


def likelihoods(found: Posterior) -> Figure:
    """Profile likelihood of each parameter on the emulator."""
    columns = min(4, len(found.marginals))
    rows = -(-len(found.marginals) // columns)
    figure = new_figure(2.7 * columns, 2.0 * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(found.marginals) :]:
        axis.set_visible(False)
    for axis, marginal in zip(axes, found.marginals, strict=False):
        unit, factor = units.readable(marginal.quantiles[2], marginal.unit)
        axis.plot(marginal.profile[:, 0] / factor, marginal.profile[:, 1], color=MODEL, lw=1.1)
        axis.axhline(CONFIDENCE, color=SHADE, lw=0.7, ls="--")
        axis.set_ylim(0, 2.5 * CONFIDENCE)
        axis.set_title(_with_unit(marginal.free.symbol, unit), fontsize=9)
    axes[0].set_ylabel("rise of χ²")
    return figure


def correlations(result: FitResult) -> Figure:
    """The correlation matrix of the identified parameters."""
    names = [e.free.symbol for e in result.estimates]
    size = 1.6 + 0.42 * len(names)
    figure = new_figure(size + 0.9, size)
    axis = figure.subplots()
    image = axis.imshow(result.correlation, vmin=-1, vmax=1, cmap="RdBu_r")
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(len(names)), names)
    axis.grid(False)
    if len(names) <= 12:
        for (i, j), r in np.ndenumerate(result.correlation):
            if np.isfinite(r):
                axis.text(j, i, f"{r:.2f}", ha="center", va="center", fontsize=7, color="w" if abs(r) > 0.6 else "k")
    figure.colorbar(image, ax=axis, shrink=0.8, label="correlation")
    return figure


def profile_plots(found: list[Estimate]) -> Figure:
    """Rise of chi-squared along each parameter, beside what the linear theory expects."""
    columns = min(4, len(found))
    rows = -(-len(found) // columns)
    figure = new_figure(2.7 * columns, 2.3 * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(found) :]:
        axis.set_visible(False)
    for axis, estimate in zip(axes, found, strict=False):
        assert estimate.profile is not None
        values, rise = estimate.profile.T
        unit, factor = units.readable(estimate.value, estimate.unit)
        line = np.linspace(values.min(), values.max(), 60)
        if estimate.free.log:
            distance = np.log(line / estimate.value) / (estimate.standard_error / estimate.value)
        else:
            distance = (line - estimate.value) / estimate.standard_error
        axis.plot(line / factor, distance**2, color=GRID, lw=2.5, label="linear theory")
        axis.plot(values / factor, rise, "o-", color=MODEL, ms=3.5, lw=1.1, label="refitted")
        axis.axhline(CONFIDENCE, color=SHADE, lw=0.7, ls="--")
        axis.set_ylim(0, 2.5 * CONFIDENCE)
        axis.set_title(f"{estimate.free.symbol}{f', {unit}' if unit else ''}", fontsize=9)
    axes[0].legend(fontsize=7)
    axes[0].set_ylabel("rise of χ²")
    return figure
