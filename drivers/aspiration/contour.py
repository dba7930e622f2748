"""The threshold pipeline: from camera frames to the tissue's contour, its apex and how sure that is.

Weickenmeier et al. (2015) turn grey images into black and white at a grey-value threshold (GVT) set by eye for each
site, and read from them the initial tissue height and the displacement of the apex. Here the GVT may still be set by
hand; if not, one is proposed. Every apex comes with the band that a GVT ± ``delta`` would give.

    even light (background) -> GVT -> the one component that is tissue -> sub-pixel edge -> foot, apex, band, confidence

Rows and columns count pixel middles, row 0 on top, whatever way the apex points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.aspiration import apex as caps
from drivers.aspiration import background, segment
from drivers.aspiration.threshold import LEAST_AREA, propose
from drivers.contour import Contour

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_BAND_SEARCH = 12  # px in which the edge at GVT ± delta is looked for
_MARGIN = 6.0  # px from the upper border within which an apex is not believed
_SOFT = 0.35  # of the usual grey step across the edge; columns below it are not trusted


@dataclass(frozen=True)
class Settings:
    """How frames are read.

    ``gvt`` in grey values of the evened image (those of the raw image where the light is brightest), None to have one
    proposed; ``delta`` grey values for the band; ``background`` ``estimate`` (of a bright field behind dark tissue;
    bright tissue shows too little of the light, so nothing is done), ``none``, or an image of the empty field;
    ``roi`` (left, top, width, height) px, the rest is not looked at; ``initial_frames`` how many frames
    at the beginning give the initial tissue height.
    """

    gvt: float | None = None
    delta: float = 10.0
    apex: Literal["up", "down"] = "up"
    tissue: Literal["dark", "bright"] = "dark"
    background: Literal["estimate", "none"] | NDArray[Any] = "estimate"
    roi: tuple[int, int, int, int] | None = None
    initial_frames: int = 5


class Pipeline:
    """Settings made definite on some frames of a series (its light, its GVT), ready to measure all of them.

    ``gvt`` is the threshold in use, ``gvt_confidence`` how sure the proposal is (1 for one set by hand).
    """

    def __init__(self, settings: Settings, gain: NDArray[np.float32], gvt: float, gvt_confidence: float) -> None:
        self.settings = settings
        self.gvt = gvt
        self.gvt_confidence = gvt_confidence
        self._gain = gain

    @classmethod
    def prepare(cls, frames: Sequence[Image], settings: Settings) -> Pipeline:
        """Take the light from the first of ``frames`` (height, width) and the GVT from all of them.

        Raises ValueError: no frame, not 8 bit grey, or a flat field or region that does not fit.
        """
        if len(frames) == 0:
            raise ValueError("there are no frames")
        for frame in frames:
            _check(frame, settings)
        gain = _gain(frames[0], settings)
        if settings.gvt is not None:
            return cls(settings, gain, settings.gvt, 1.0)
        # The proposal is as sure as the contour that it gives, and as little as the proposals scatter.
        proposals, sureness = [], []
        for frame in frames:
            gvt = propose(_evened(frame, gain, settings))
            if gvt is not None:
                gvt = _turned(gvt, settings)
                proposals.append(gvt)
                sureness.append(cls(settings, gain, gvt, 1.0).measure(frame).confidence)
        if not proposals:
            return cls(settings, gain, 127.5, 0.0)
        scatter = float(np.std(proposals)) / max(settings.delta, 1.0)
        return cls(settings, gain, float(np.median(proposals)), float(np.median(sureness)) / (1 + scatter**2))

    def measure(self, frame: Image) -> Contour:
        """The contour in one frame (height, width). Raises ValueError for one that is not 8 bit grey."""
        settings = self.settings
        _check(frame, settings)
        grey = _evened(frame, self._gain, settings)
        gvt = _turned(self.gvt, settings)
        tissue = _find(grey, gvt)
        if isinstance(tissue, str):
            return Contour(self.gvt, flags=(tissue,))
        return _placed(replace(_read(grey, gvt, settings.delta, tissue), gvt=self.gvt), frame.shape, settings)


def analyse_frame(image: Image, settings: Settings | None = None) -> Contour:
    """The contour in one image (height, width) of 8 bit grey, light and GVT taken from that image.

    Raises ValueError for an image that is not 8 bit grey.
    """
    settings = settings or Settings()
    return Pipeline.prepare([image], settings).measure(image)


def analyse_frames(
    frames: Any,
    scale: float,
    settings: Settings | None = None,
    known: Callable[[int], Contour | None] | None = None,
) -> dict[str, Any]:
    """Height, apex displacement and profile over time; ``frames`` (n, height, width), ``scale`` m/px.

    ``known(index)`` is the contour that was read in a frame before, by the same settings; where it was read at the
    threshold in use it is not read again (``reread`` of the result counts the frames that were).

    The light is that of the first frame; the GVT, if not set, the median of proposals for five frames. All in m:

    - ``height`` (n,) from the foot to the apex, the foot being that of the initial frames;
    - ``band_low``, ``band_high`` (n,) the same at GVT ± delta;
    - ``initial_height`` scalar, the median height of the initial frames; ``apex`` (n,) = height - initial_height;
    - ``profile`` (n, width) height of the edge above the foot in each column, NaN where there is none;

    and ``confidence`` (n,), ``gvt``, ``gvt_confidence``, ``flags`` (n,) tuples. Raises ValueError as `analyse_frame`.
    """
    settings = settings or Settings()
    if not scale > 0:
        raise ValueError(f"the scale must be positive, not {scale}")
    pipeline = Pipeline.prepare(_spread_out(frames, 5), settings)
    found, reread = _contours(frames, pipeline, known)
    foot = _usual([c.foot_row for c in found[: settings.initial_frames]])
    sign = 1.0 if settings.apex == "up" else -1.0
    height = sign * (foot - np.array([c.apex_row for c in found])) * scale
    below, above = (np.array([c.band[side] - c.height for c in found]) * scale for side in (0, 1))
    initial_height = _usual(height[: settings.initial_frames])
    width = frames[0].shape[1]
    profile = np.array([c.profile if len(c.profile) else np.full(width, np.nan) for c in found])
    return {
        "height": height,
        "band_low": height + below,
        "band_high": height + above,
        "initial_height": initial_height,
        "apex": height - initial_height,
        "profile": sign * (foot - profile) * scale,
        "confidence": np.array([c.confidence for c in found]),
        "gvt": pipeline.gvt,
        "gvt_confidence": pipeline.gvt_confidence,
        "flags": [c.flags for c in found],
        "reread": reread,
    }


def _spread_out(frames: Any, count: int) -> list[Image]:
    """Up to ``count`` frames at equal distances, the first and the last among them."""
    n = len(frames)
    return [np.asarray(frames[k]) for k in sorted({round(k) for k in np.linspace(0, n - 1, count)})] if n else []


def _contours(
    frames: Any, pipeline: Pipeline, known: Callable[[int], Contour | None] | None
) -> tuple[list[Contour], int]:
    """The contour in every frame, and how many had to be read: not those ``known`` at the threshold in use."""
    found, reread = [], 0
    for k in range(len(frames)):
        contour = known(k) if known is not None else None
        if contour is None or contour.gvt != pipeline.gvt:
            contour = pipeline.measure(np.asarray(frames[k]))
            reread += 1
        found.append(contour)
    return found, reread


def _usual(values: Sequence[float] | FloatArray) -> float:
    """The median of the finite values, NaN where there is none."""
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


@dataclass(frozen=True)
class _Tissue:
    """The component that is tissue: its first row, sub-pixel edge and grey step by column, and its sides by row."""

    top: segment.IntArray
    profile: FloatArray
    step: FloatArray
    sides: FloatArray
    flags: tuple[str, ...]


def _find(grey: segment.Grey, gvt: float) -> _Tissue | str:
    """The tissue in an upright, dark, even image, or the flag that says why there is none."""
    runs, count = segment.label(grey, gvt)
    if count < 0:
        return "noise"
    name, others = segment.choose(grey, runs, count, max(int(LEAST_AREA / 20 * grey.size), 12))
    if name < 0:
        return "no_tissue"
    top = segment.envelope(runs, count, name, grey.shape[1])
    outside, inside = segment.contrast(grey, top)
    step = outside - inside
    profile = segment.crossings(grey, top, gvt, 1)
    if not segment.cut_soft(profile, step, _SOFT):
        return "no_tissue"
    sides = segment.sides(grey, runs, count, name, gvt)
    noticed = {
        "reflections": segment.holes(runs, count, name, 3) > 0,
        "satellites": others > 0,
        "border": (sides[0] <= 0).any() != (sides[1] >= grey.shape[1] - 1).any(),
    }
    return _Tissue(top, profile, step, sides, tuple(flag for flag, seen in noticed.items() if seen))


def _read(grey: segment.Grey, gvt: float, delta: float, tissue: _Tissue) -> Contour:
    """Foot, apex, band and confidence of the tissue, in px of the upright image."""
    top, profile = tissue.top, tissue.profile
    clean = caps.cleaned(profile)
    foot = caps.foot(profile, clean, tissue.sides)
    first, last = caps.cap(clean, foot)
    column, row, scatter, share = caps.fit(profile, first, last)
    # Tissue at the upper border within the cap, or so close that no edge can be seen above it.
    if last == first or row < _MARGIN or np.any(top[max(first - 2, 0) : last + 2] == 0):
        return Contour(gvt, foot_row=foot, profile=profile, sides=tissue.sides, flags=("cut_off", *tissue.flags))
    height = foot - row
    heights = [height]
    for shift in (-delta, delta):
        moved = segment.crossings(grey, top, gvt + shift, _BAND_SEARCH)
        moved[np.isnan(profile)] = np.nan
        heights.append(foot - caps.fit(moved, first, last)[1])
    low, high = float(np.min(heights)), float(np.max(heights))  # NaN where an edge is lost at one of the thresholds
    step = tissue.step[first:last][np.isfinite(profile[first:last])]
    clear = float(np.median(step)) if len(step) else 0.0
    noticed = {"gaps": share < 0.9, "low_contrast": clear < 30}
    return Contour(
        gvt,
        column,
        row,
        foot,
        height,
        (low, high),
        profile,
        tissue.sides,
        _confidence(clear, share, scatter, (high - low) / 2),
        (*tissue.flags, *(flag for flag, seen in noticed.items() if seen)),
    )


def compile_kernels() -> None:
    """Run every kernel once, so that the first frame of a measurement does not wait for the compiler."""
    rows, columns = np.mgrid[:64, :64]
    dome = np.where(rows > 32 + (columns - 32) ** 2 / 60, 20, 200).astype(np.uint8)
    analyse_frame(dome)


def _confidence(step: float, share: float, scatter: float, half_band: float) -> float:
    """0 … 1, a product of four signs that the apex means something.

    Each is 1/2 at the value given: a grey step of 15 across the edge, 7 columns in 10 of the cap on a smooth curve, a
    scatter of 0.5 px about it, a band of ± 2 px.
    """
    if not np.isfinite(half_band):
        return 0.0
    clear = step**2 / (step**2 + 15.0**2) if step > 0 else 0.0
    smooth = 1 / (1 + (scatter / 0.5) ** 2)
    whole = min(max((share - 0.4) / 0.6, 0.0), 1.0)
    narrow = 1 / (1 + (half_band / 2.0) ** 2)
    return float(clear * smooth * whole * narrow)


def _check(frame: Image, settings: Settings) -> None:
    if frame.ndim != 2 or frame.dtype != np.uint8:
        raise ValueError(f"a frame is 8 bit grey (height, width), not {frame.dtype} of shape {frame.shape}")
    if settings.roi is not None:
        left, top, width, height = settings.roi
        inside = left >= 0 and top >= 0 and left + width <= frame.shape[1] and top + height <= frame.shape[0]
        if not inside or width < 16 or height < 16:
            raise ValueError(
                f"the region {settings.roi} is not at least 16 x 16 px inside a frame of {frame.shape[::-1]}"
            )


def _cut(image: NDArray[Any], settings: Settings) -> NDArray[Any]:
    if settings.roi is None:
        return np.ascontiguousarray(image)
    left, top, width, height = settings.roi
    return np.ascontiguousarray(image[top : top + height, left : left + width])


def _gain(frame: Image, settings: Settings) -> NDArray[np.float32]:
    if isinstance(settings.background, np.ndarray):
        if settings.background.shape != frame.shape:
            raise ValueError(f"the flat field has shape {settings.background.shape}, the frames {frame.shape}")
        return np.asarray(_cut(background.from_flat_field(settings.background), settings))
    # A bright bubble before a dark field shows nothing of the light where there is no tissue.
    if settings.background == "none" or settings.tissue == "bright":
        return np.ones((1, 1), np.float32)
    return background.estimate(_cut(frame, settings))


def _evened(frame: Image, gain: NDArray[np.float32], settings: Settings) -> segment.Grey:
    grey: segment.Grey = segment.normalise(
        _cut(frame, settings), gain, settings.tissue == "bright", settings.apex == "down"
    )
    return grey


def _turned(gvt: float, settings: Settings) -> float:
    """A threshold between the frame's grey values and those of the dark image."""
    return gvt if settings.tissue == "dark" else 255.0 - gvt


def _placed(contour: Contour, shape: tuple[int, ...], settings: Settings) -> Contour:
    """From upright rows and columns of the region to those of the frame."""
    left, top, width, height = settings.roi or (0, 0, shape[1], shape[0])
    down = settings.apex == "down"

    def row(value: Any) -> Any:
        return top + (height - 1 - value if down else value)

    profile = np.full(shape[1], np.nan)
    profile[left : left + width] = row(contour.profile)
    sides = np.full((2, shape[0]), np.nan)
    sides[:, top : top + height] = left + (contour.sides[:, ::-1] if down else contour.sides)
    return replace(
        contour,
        apex_column=left + contour.apex_column,
        apex_row=row(contour.apex_row),
        foot_row=row(contour.foot_row),
        profile=profile,
        sides=sides,
    )
