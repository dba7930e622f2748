"""The threshold pipeline on rendered frames, whose contour is known, and on photographs of real bubbles."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.aspiration.background import estimate, from_flat_field
from drivers.aspiration.contour import Pipeline, Settings, analyse_frame, analyse_frames
from drivers.aspiration.live import LiveApex
from drivers.contour import Contour
from sim_devices.stages.scene import Light, Scene, background
from tests.conftest import Folder
from tests.standins import example

HEIGHTS = np.concatenate([np.zeros(5), np.linspace(0.0, 4e-3, 20)])
HARSH = Light(vignetting=0.6, gradient=0.4, reflections=5, satellites=8, blur=2.0, noise=4.0)


def frames(scene: Scene, heights: np.ndarray = HEIGHTS) -> np.ndarray:
    return np.array([scene(h, k / 25) for k, h in enumerate(heights)])


def rms(values: np.ndarray) -> float:
    assert np.isfinite(values).all()
    return float(np.sqrt(np.mean(values**2)))


# Rendered truth ------------------------------------------------------------------------------------------------------

SCENES = {
    "ideal": Scene(light=Light.ideal()),
    "realistic": Scene(seed=1),
    "bell-shaped": Scene(roundness=1.6, seed=2),
    "harsh light": Scene(light=HARSH, seed=3),
    "weak contrast": Scene(light=Light(bright=110.0, dark=60.0, noise=3.0), seed=4),
    "coarse": Scene(size=(320, 240), scale=4e-5, seed=5),
}


@pytest.mark.parametrize("name", SCENES)
def test_apex_displacement_is_right_to_a_tenth_of_a_pixel(name: str) -> None:
    scene = SCENES[name]
    found = analyse_frames(frames(scene), scene.scale)
    assert rms(found["apex"] - HEIGHTS) / scene.scale <= 0.1
    assert found["gvt_confidence"] > 0.5
    assert np.all(found["band_low"] <= found["height"])
    assert np.all(found["height"] <= found["band_high"])


def test_initial_height_and_profile_are_right() -> None:
    scene = SCENES["realistic"]
    found = analyse_frames(frames(scene), scene.scale)
    assert found["initial_height"] == pytest.approx(scene.initial_height, abs=0.2 * scene.scale)
    truth = scene.base_row - scene.profile(HEIGHTS[-1])
    assert np.nanmax(np.abs(found["profile"][-1] / scene.scale - truth)[140:500]) < 0.6
    assert rms((found["profile"][-1] / scene.scale - truth)[140:500]) < 0.15


def test_a_recorded_flat_field_evens_the_light() -> None:
    scene = Scene(light=HARSH, seed=6)
    found = analyse_frames(frames(scene), scene.scale, Settings(background=background(scene)))
    assert rms(found["apex"] - HEIGHTS) / scene.scale <= 0.1
    assert rms(found["height"] - scene.initial_height - HEIGHTS) / scene.scale <= 0.1


def test_the_estimated_background_is_the_real_one() -> None:
    scene = Scene(light=replace(HARSH, noise=1.0), seed=7)
    gain = estimate(scene(2e-3))
    evened = background(scene) * gain
    assert np.std(evened[:380]) / np.mean(evened[:380]) < 0.02


def test_apex_down_and_bright_tissue_are_the_same_turned_round() -> None:
    scene = Scene(seed=8)
    image = scene(2e-3)
    up = analyse_frame(image)
    down = analyse_frame(image[::-1], Settings(apex="down"))
    assert down.height == pytest.approx(up.height, abs=0.02)
    assert down.apex_row == pytest.approx(479 - up.apex_row, abs=0.02)
    assert np.allclose(down.profile, 479 - up.profile, atol=0.05)
    bright = Scene(polarity="bright", seed=8)
    found = analyse_frames(frames(bright), bright.scale, Settings(tissue="bright"))
    assert rms(found["apex"] - HEIGHTS) / bright.scale <= 0.1


def test_a_region_of_interest_keeps_the_frames_coordinates() -> None:
    scene = Scene(seed=9)
    whole = analyse_frame(scene(2e-3))
    part = analyse_frame(scene(2e-3), Settings(roi=(60, 100, 520, 370)))
    assert part.apex_row == pytest.approx(whole.apex_row, abs=0.05)
    assert part.apex_column == pytest.approx(whole.apex_column, abs=1.5)
    assert part.profile.shape == (640,)
    assert np.isnan(part.profile[:60]).all()


# Spoilt pictures -----------------------------------------------------------------------------------------------------


def test_a_reflection_on_the_apex_does_not_lower_it() -> None:
    scene = Scene(light=Light.ideal())
    image = scene(2e-3)
    clean = analyse_frame(image)
    row = round(clean.apex_row)
    image[row - 2 : row + 10, 316:326] = 220  # a highlight that eats a notch into the edge
    notched = analyse_frame(image)
    assert notched.apex_row == pytest.approx(clean.apex_row, abs=0.1)


def test_a_speck_of_dirt_on_the_edge_does_not_raise_it() -> None:
    scene = Scene(light=Light.ideal())
    image = scene(2e-3)
    clean = analyse_frame(image)
    row = round(clean.apex_row)
    image[row - 9 : row + 1, 325:333] = 30
    assert analyse_frame(image).apex_row == pytest.approx(clean.apex_row, abs=0.1)


@pytest.mark.parametrize("column", [6, 40, 600, 634])
def test_dirt_on_the_rim_is_not_the_apex_even_of_flat_tissue(column: int) -> None:
    scene = Scene(light=Light.ideal(), initial_height=0.05e-3)
    for height in (0.0, 1e-3):
        image = scene(height)
        cv2.circle(image, (column, 425), 14, 30, -1)
        found = analyse_frame(image)
        assert found.apex_row == pytest.approx(scene.profile(height).min(), abs=0.3)
        assert found.foot_row == pytest.approx(scene.base_row, abs=0.3)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 1000),
    bright=st.floats(100, 240),
    dark=st.floats(5, 50),
    vignetting=st.floats(0, 0.7),
    gradient=st.floats(0, 0.4),
    blur=st.floats(0.7, 3.0),
    noise=st.floats(0.5, 3.0),
    roundness=st.floats(0.8, 2.0),
)
def test_any_light_gives_the_apex_to_a_tenth_of_a_pixel(
    seed: int,
    bright: float,
    dark: float,
    vignetting: float,
    gradient: float,
    blur: float,
    noise: float,
    roundness: float,
) -> None:
    light = Light(bright, dark, vignetting, gradient, reflections=4, satellites=8, blur=blur, noise=noise)
    scene = Scene(light=light, roundness=roundness, seed=seed)
    heights = np.array([0.0, 0.0, 0.0, 0.3e-3, 1e-3, 2.2e-3, 3.7e-3])
    found = analyse_frames(frames(scene, heights), scene.scale, Settings(initial_frames=3))
    assert rms(found["apex"] - heights) / scene.scale <= 0.1


def test_satellites_and_reflections_are_told() -> None:
    plain = analyse_frame(Scene(light=Light.ideal())(2e-3))
    spotted = analyse_frame(Scene(light=HARSH, seed=3)(2e-3))
    assert plain.flags == ()
    assert {"satellites", "reflections"} <= set(spotted.flags)


def test_a_bubble_beyond_the_upper_border_has_no_apex() -> None:
    found = analyse_frame(Scene(light=Light.ideal())(9e-3))
    assert np.isnan(found.height)
    assert np.isnan(found.apex_row)
    assert found.confidence == 0
    assert "cut_off" in found.flags


def test_an_empty_or_noisy_picture_has_no_contour() -> None:
    for image in (
        np.full((480, 640), 128, np.uint8),
        np.zeros((480, 640), np.uint8),
        np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8),
    ):
        found = analyse_frame(image)
        assert not found.confidence > 0.3


def test_a_soft_edge_lowers_the_confidence_and_widens_the_band() -> None:
    def seen(blur: float) -> Contour:
        return analyse_frame(Scene(light=replace(Light.ideal(), blur=blur))(2e-3))

    sharp, soft = seen(1.0), seen(12.0)
    assert soft.confidence < 0.6 * sharp.confidence
    assert np.diff(soft.band)[0] > 5 * np.diff(sharp.band)[0]


# Thresholds ----------------------------------------------------------------------------------------------------------


def test_a_threshold_set_by_hand_is_used_and_shifts_the_apex_as_the_band_says() -> None:
    image = Scene(light=replace(Light.ideal(), blur=3.0))(2e-3)
    proposed = analyse_frame(image)
    higher = analyse_frame(image, Settings(gvt=proposed.gvt + 10))
    lower = analyse_frame(image, Settings(gvt=proposed.gvt - 10))
    assert higher.gvt == proposed.gvt + 10
    assert proposed.foot_row - higher.apex_row == pytest.approx(proposed.band[1], abs=0.02)
    assert proposed.foot_row - lower.apex_row == pytest.approx(proposed.band[0], abs=0.02)


def test_the_proposal_is_halfway_up_the_edge() -> None:
    scene = Scene(light=Light.ideal())
    assert analyse_frame(scene(2e-3)).gvt == pytest.approx((scene.light.bright + scene.light.dark) / 2, abs=2)


# Live ----------------------------------------------------------------------------------------------------------------


def test_live_apex_follows_from_the_first_frame_on() -> None:
    scene = Scene(seed=11)
    live = LiveApex(scene.scale)
    heights = np.array([live(image) for image in frames(scene)])
    assert rms(heights - HEIGHTS) / scene.scale <= 0.1
    assert live.latest is not None
    assert live.latest.confidence > 0.8
    assert len(live.latest.outline()) > 300


def test_live_apex_is_no_number_without_tissue() -> None:
    live = LiveApex(2e-5)
    assert np.isnan(live(np.full((120, 160), 200, np.uint8)))


# Input that is wrong -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("image", "wrong", "says"),
    [
        (np.zeros((10, 10, 3), np.uint8), Settings(), "8 bit grey"),
        (np.zeros((10, 10), np.uint16), Settings(), "8 bit grey"),
        (np.zeros((100, 100), np.uint8), Settings(roi=(90, 0, 20, 20)), "inside a frame"),
        (np.zeros((100, 100), np.uint8), Settings(background=np.ones((10, 10))), "flat field has shape"),
    ],
)
def test_wrong_input_is_refused(image: np.ndarray, wrong: Settings, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        analyse_frame(image, wrong)


def test_no_frames_no_scale_and_a_black_flat_field_are_refused() -> None:
    with pytest.raises(ValueError, match="no frames"):
        analyse_frames(np.empty((0, 100, 100), np.uint8), 2e-5)
    with pytest.raises(ValueError, match="scale"):
        analyse_frames(np.zeros((1, 100, 100), np.uint8), 0.0)
    with pytest.raises(ValueError, match="black"):
        from_flat_field(np.zeros((100, 100)))


# Real pictures -------------------------------------------------------------------------------------------------------

# Rows of the needle's upper end and of the apex, read by eye in the reduced pictures of examples/bubble_bundle.
REAL = {"gttab": (577, 319), "gwater": (546, 268), "calibrated": (328, 52)}


def real(name: str, public_data: Folder) -> np.ndarray:
    module = example("bubble_bundle")
    image, every, *_ = module.BUNDLES[name]
    picture: np.ndarray = module.smaller(public_data("bubble_on_needle_cc0") / image, every)
    return picture


@pytest.mark.parametrize("name", REAL)
def test_one_dome_of_sensible_height_in_each_real_picture(name: str, public_data: Folder) -> None:
    needle, top = REAL[name]
    found = analyse_frame(real(name, public_data))
    assert found.foot_row == pytest.approx(needle, abs=4)
    assert found.apex_row == pytest.approx(top, abs=2)
    assert found.confidence > 0.8
    assert np.diff(found.band)[0] < 1.0
    outline = found.outline()
    assert len(outline) > 300
    assert np.hypot(*np.diff(outline, axis=0).T).max() < 12  # one curve without a jump


def test_otsu_shatters_the_picture_that_the_pipeline_reads(public_data: Folder) -> None:
    image = real("calibrated", public_data)
    _, binary = cv2.threshold(image, 0, 255, cv2.THRESH_OTSU)
    contours, _ = cv2.findContours(binary, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    assert len(contours) > 50
    pipeline = Pipeline.prepare([image], Settings())
    assert pipeline.gvt_confidence > 0.8
    assert "reflections" in pipeline.measure(image).flags
