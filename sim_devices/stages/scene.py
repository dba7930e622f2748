"""The picture of the aspiration device's camera: the tissue bubble from the side, in realistic light.

A dark silhouette stands on the rim plane before a bright field (``polarity="bright"`` turns that round: the published
descriptions allow either). The edge is rendered from its exact geometry with the lens blur as an error function across
it, so that the true contour is known to a hundredth of a pixel; light and dirt are put over that.

Everything about the light is assumed: the papers show that the threshold had to be set by eye for each site, not why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import expit

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_NOISE_POOL = 1 << 21  # samples of white noise, read from a place that depends on seed and time
_EDGE = 3.5  # half width of the rendered edge, in blurs: the error function is flat to 2e-4 there


@dataclass(frozen=True)
class Light:
    """Light of the scene, and disturbances of the image. Grey values of 8 bit; lengths in px unless said otherwise.

    ``vignetting`` and ``gradient`` are the relative loss of light in the far corner and from left to right.
    ``reflections`` bright spots lie on the bubble and move with it, the first near its apex; ``satellites`` dark blobs
    of dirt hang in the field, clear of the bubble; ``noise`` is read noise, ``shot`` the variance per grey value.
    """

    bright: float = 200.0
    dark: float = 25.0
    vignetting: float = 0.25
    gradient: float = 0.10
    reflections: int = 2
    satellites: int = 3
    blur: float = 1.2
    noise: float = 1.5
    shot: float = 0.02

    @classmethod
    def ideal(cls) -> Light:
        """Even light, no dirt, no noise."""
        return cls(vignetting=0.0, gradient=0.0, reflections=0, satellites=0, noise=0.0, shot=0.0)


class Scene:
    """Renders images (height, width) of 8 bit; call it with the bubble's apex height in m and the time in s.

    ``size`` (width, height) px; ``scale`` m/px; ``opening`` m, the diameter of the rim; ``initial_height`` m, how far
    the tissue stands above the rim before suction; ``roundness`` p of the profile h (1 - (x/a)²)^p (1 is a parabola).
    ``base_row`` is the row of the rim plane, by default at 0.9 of the image's height; row r is the middle of the r-th
    line of pixels. The same seed, height and time give the same image.
    """

    def __init__(
        self,
        size: tuple[int, int] = (640, 480),
        scale: float = 2e-5,
        opening: float = 8e-3,
        *,
        initial_height: float = 0.2e-3,
        roundness: float = 1.0,
        light: Light | None = None,
        polarity: Literal["dark", "bright"] = "dark",
        base_row: float | None = None,
        seed: int = 0,
    ) -> None:
        self.size, self.scale, self.opening = size, scale, opening
        self.initial_height = initial_height
        self.base_row = round(0.9 * size[1]) if base_row is None else base_row
        self.light = light or Light()
        self._seed = seed
        self._bright_tissue = polarity == "bright"
        width = size[0]
        x = (np.arange(width) - (width - 1) / 2) * scale / (opening / 2)
        self._shape = np.clip(1 - x**2, 0.0, None) ** roundness
        rng = np.random.default_rng([seed, 0])
        self._field = _field(size, self.light, rng, clear_of=self._reach())
        self._spots = _spots(self.light.reflections, rng)
        self._noise = np.random.default_rng([seed, 1]).standard_normal(_NOISE_POOL, dtype=np.float32)

    def profile(self, apex_height: float) -> FloatArray:
        """True row of the edge in each column, shape (width,), for an apex ``apex_height`` m above its rest."""
        row: FloatArray = self.base_row - (self.initial_height + apex_height) / self.scale * self._shape
        return row

    def __call__(self, apex_height: float, time: float = 0.0) -> Image:
        """The image of a bubble whose apex is ``apex_height`` m above the tissue at rest.

        Raises ValueError for a height that is not finite.
        """
        if not math.isfinite(apex_height):
            raise ValueError(f"the apex height must be finite, not {apex_height}")
        light = self.light
        edge = self.profile(apex_height)
        slope = np.gradient(edge)
        # Weyl's sequence spreads the beginnings of the noise over the pool, whatever the frame rate.
        offset = int((0.6180339887498949 * (self._seed * 7919 + round(time * 1e6)) % 1.0) * (_NOISE_POOL // 2))
        return _render(
            self._field,
            edge,
            np.sqrt(1 + slope**2) * light.blur,
            self._placed_spots(edge),
            self._noise[offset:],
            light.bright,
            light.dark,
            light.noise,
            light.shot,
            self._bright_tissue,
        )

    def _reach(self) -> tuple[float, float, float]:
        """Centre (x, y) and radius in px of the part of the image that bubbles up to half the opening use."""
        reach = self.opening / 2 / self.scale
        return (self.size[0] - 1) / 2, self.base_row, reach + 25.0

    def _placed_spots(self, edge: FloatArray) -> FloatArray:
        """Reflections as rows of (column, row, radius, strength), each at its depth below the edge."""
        centre = (self.size[0] - 1) / 2
        half = self.opening / 2 / self.scale
        height = self.base_row - edge.min()
        placed = np.empty((len(self._spots), 4))
        for k, (across, depth, radius, strength) in enumerate(self._spots):
            column = centre + across * half
            top = edge[min(max(round(column), 0), len(edge) - 1)]
            size = radius * min(height, half)
            # A bubble too low to carry the spot has none.
            placed[k] = column, top + depth * height, max(size, 0.5), strength if size > 2.0 else 0.0
        return placed


def render(apex_height: float, scene: Scene | None = None, time: float = 0.0) -> Image:
    """One image of a bubble ``apex_height`` m high; make a `Scene` yourself to render many."""
    return (scene or Scene())(apex_height, time)


def background(scene: Scene) -> Image:
    """The empty field, shape (height, width), as a lab records it for the flat-field correction."""
    clean = replace(scene.light, satellites=0)
    field = _field(scene.size, clean, np.random.default_rng(0), clear_of=(0.0, 0.0, 0.0))
    image: Image = np.clip(np.rint(field * scene.light.bright), 0, 255).astype(np.uint8)
    return image


def _field(
    size: tuple[int, int], light: Light, rng: np.random.Generator, clear_of: tuple[float, float, float]
) -> NDArray[np.float32]:
    """Relative brightness (height, width) of the bright field: vignetting (cos⁴-like), gradient, dirt out of focus."""
    width, height = size
    x = np.linspace(-1, 1, width)[None, :]
    y = np.linspace(-1, 1, height)[:, None]
    field = (1 - light.vignetting * (x**2 + y**2) ** 2 / 4) * (1 - light.gradient * (x + 1) / 2)
    columns, rows = np.arange(width)[None, :], np.arange(height)[:, None]
    cx, cy, reach = clear_of
    placed = 0
    for _ in range(100 * light.satellites):
        if placed == light.satellites:
            break
        radius = rng.uniform(2.0, 0.02 * height + 3.0)
        column, row = rng.uniform(0, width), rng.uniform(0, cy)
        if math.hypot(column - cx, row - cy) < reach + 2 * radius:
            continue
        distance = np.hypot(columns - column, rows - row)
        soft = rng.uniform(1.0, 3.0)
        field = field * (1 - rng.uniform(0.4, 0.9) * expit((radius - distance) / soft))
        placed += 1
    return field.astype(np.float32)


def _spots(count: int, rng: np.random.Generator) -> FloatArray:
    """Reflections (count, 4): place across, depth and radius relative to the bubble's size, and strength."""
    spots = np.empty((count, 4))
    for k in range(count):
        across = rng.uniform(-0.12, 0.12) if k == 0 else rng.uniform(-0.5, 0.5)
        spots[k] = across, rng.uniform(0.25, 0.4), rng.uniform(0.04, 0.1), rng.uniform(0.6, 1.1)
    return spots


@njit(cache=True, fastmath=True)
def _render(
    field: NDArray[np.float32],
    edge: FloatArray,
    blur: FloatArray,
    spots: FloatArray,
    noise: NDArray[np.float32],
    bright: float,
    dark: float,
    read_noise: float,
    shot: float,
    bright_tissue: bool,
) -> NDArray[np.uint8]:
    """The field above each column's edge, tissue below, the blur between them; then spots and noise."""
    rows, columns = field.shape
    above, below = (dark, bright) if bright_tissue else (bright, dark)
    level = np.empty((rows, columns), np.float32)
    first = np.empty(columns, np.int64)
    last = np.empty(columns, np.int64)
    for c in range(columns):
        first[c] = max(0, min(rows, math.floor(edge[c] - _EDGE * blur[c])))
        last[c] = max(0, min(rows, math.ceil(edge[c] + _EDGE * blur[c]) + 1))
    for r in range(rows):
        for c in range(columns):
            level[r, c] = above if r < first[c] else below
    for c in range(columns):
        for r in range(first[c], last[c]):
            covered = 0.5 * (1.0 + math.erf((r - edge[c]) / (math.sqrt(2.0) * blur[c])))
            level[r, c] = above + (below - above) * covered
    for k in range(spots.shape[0]):
        column, row, radius, strength = spots[k]
        reach = 3.0 * radius
        for r in range(max(0, int(row - reach)), min(rows, int(row + reach) + 1)):
            for c in range(max(0, int(column - reach)), min(columns, int(column + reach) + 1)):
                depth = r - edge[c]
                if depth > 0:
                    apart = ((r - row) ** 2 + (c - column) ** 2) / radius**2
                    fade = 1.0 - math.exp(-0.5 * (depth / blur[c]) ** 2)  # a reflection lies on the tissue only
                    level[r, c] += strength * bright * math.exp(-0.5 * apart) * fade
    image = np.empty((rows, columns), np.uint8)
    for r in range(rows):
        at = r * columns
        for c in range(columns):
            grey = level[r, c] * field[r, c]
            grey += noise[at + c] * math.sqrt(read_noise * read_noise + shot * grey) + np.float32(0.5)
            image[r, c] = np.uint8(min(max(grey, np.float32(0.0)), np.float32(255.0)))
    return image
