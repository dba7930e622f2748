import numpy as np
import pytest

from sim_devices.stages.scene import Light, Scene, background


def test_the_same_seed_height_and_time_give_the_same_image() -> None:
    one, other = Scene(seed=3), Scene(seed=3)
    assert np.array_equal(one(1e-3, 0.04), other(1e-3, 0.04))
    assert not np.array_equal(one(1e-3, 0.04), one(1e-3, 0.08))
    assert not np.array_equal(one(1e-3, 0.04), Scene(seed=4)(1e-3, 0.04))


def test_the_apex_stands_where_its_height_says() -> None:
    scene = Scene(light=Light.ideal(), initial_height=0.2e-3)
    profile = scene.profile(1.3e-3)
    assert profile.min() == pytest.approx(scene.base_row - 1.5e-3 / scene.scale, abs=1e-2)
    image = scene(1.3e-3).astype(float)
    column = image[:, 320]
    half = (scene.light.bright + scene.light.dark) / 2
    row = int(np.argmax(column < half))
    crossing = row - 1 + (column[row - 1] - half) / (column[row - 1] - column[row])
    assert crossing == pytest.approx(profile[320], abs=0.02)


def test_light_falls_off_and_the_background_shows_it() -> None:
    scene = Scene(light=Light(vignetting=0.5, gradient=0.3))
    empty = background(scene).astype(float)
    assert empty.shape == (480, 640)
    assert empty[0, -1] < 0.55 * empty[240, 320]
    assert empty[240, 600] < empty[240, 40]


def test_reflections_are_on_the_bubble_and_satellites_off_it() -> None:
    plain = Scene(light=Light.ideal())(2e-3).astype(int)
    changed = Scene(light=Light(vignetting=0, gradient=0, satellites=0, reflections=4, noise=0, shot=0))(2e-3) - plain
    edge = Scene(light=Light.ideal()).profile(2e-3)
    rows, columns = np.nonzero(np.abs(changed) > 3)
    assert len(rows)
    assert np.all(rows >= edge[columns] - 1)
    dirt = Scene(light=Light(vignetting=0, gradient=0, satellites=5, reflections=0, noise=0, shot=0))(2e-3) - plain
    rows, columns = np.nonzero(np.abs(dirt) > 10)
    assert len(rows)
    assert np.all(rows < edge[columns])


def test_bright_tissue_and_other_sizes() -> None:
    image = Scene(size=(160, 120), scale=8e-5, polarity="bright")(2e-3)
    assert image.shape == (120, 160)
    assert image[-1, 80] > image[0, 80]


def test_a_height_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        Scene()(float("nan"))
