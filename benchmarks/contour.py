"""Speed and accuracy of the threshold pipeline on rendered truth: ``python benchmarks/contour.py``.

Targets: at least 500 frames/s of 640 x 480 on one core, apex error at most 0.1 px rms.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from drivers.aspiration.contour import Pipeline, Settings, analyse_frames
from sim_devices.stages.scene import Light, Scene

FRAMES = 400
HARSH = Light(vignetting=0.6, gradient=0.4, reflections=5, satellites=8, blur=2.0, noise=4.0)
SCENES = {
    "even light, no noise": Light.ideal(),
    "realistic light": Light(),
    "harsh light": HARSH,
    "weak contrast": Light(bright=110.0, dark=60.0, noise=3.0),
}


@dataclass(frozen=True)
class Result:
    """One scene: frames/s of a core measuring, rendering, and errors in px rms."""

    measuring: float
    rendering: float
    displacement: float
    height: float
    band: float


def run(light: Light) -> Result:
    """Render a bubble that rises to 4 mm and falls again, and measure it."""
    scene = Scene(light=light, seed=1)
    heights = np.concatenate([np.zeros(5), 4e-3 * np.sin(np.linspace(0, np.pi, FRAMES - 5))])
    scene(0.0)
    begin = time.process_time()
    frames = np.array([scene(h, k / 25) for k, h in enumerate(heights)])
    rendering = FRAMES / (time.process_time() - begin)
    pipeline = Pipeline.prepare([frames[0], frames[FRAMES // 2]], Settings())
    pipeline.measure(frames[0])
    begin = time.process_time()
    for frame in frames:
        pipeline.measure(frame)
    measuring = FRAMES / (time.process_time() - begin)
    found = analyse_frames(frames, scene.scale)
    truth = np.array([scene.base_row - scene.profile(h).min() for h in heights])
    return Result(
        measuring,
        rendering,
        _rms(found["apex"] / scene.scale - (truth - truth[0])),
        _rms(found["height"] / scene.scale - truth),
        float(np.mean(found["band_high"] - found["band_low"])) / scene.scale,
    )


def main() -> None:
    """Print the table."""
    print("threshold pipeline, 640 x 480, one core (process time)")
    print(f"{'scene':<22}{'measured':>14}{'rendered':>14}{'displacement':>16}{'height':>12}{'band':>10}")
    for name, light in SCENES.items():
        r = run(light)
        print(
            f"{name:<22}{r.measuring:>9.0f} fr/s{r.rendering:>9.0f} fr/s"
            f"{r.displacement:>9.3f} px rms{r.height:>9.3f} px{r.band:>7.2f} px"
        )
    print("target                  ≥ 500 fr/s    ≥ 500 fr/s   ≤ 0.1 px rms")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
