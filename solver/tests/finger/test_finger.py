"""The fingertip's cross-section: geometry, sensitivities, which layer matters."""

from __future__ import annotations

import numpy as np
import pytest

from skinrig_solver import Experiment, models
from skinrig_solver.finger import FingerGeometry
from skinrig_solver.finger.section import LAYERS

MODEL = models()["finger_section"]
TIME = np.linspace(0.0, 1.0, 5)


def suction(**geometry: object) -> Experiment:
    return Experiment("cutometer", TIME, {"pressure": -1.5e4 * TIME}, geometry)


def test_mesh_has_every_layer_and_fills_the_outline() -> None:
    geometry = FingerGeometry(ridge_height=0.0)
    mesh = geometry.build()
    assert mesh.layer_names == LAYERS
    assert set(mesh.layer) == set(range(5))
    assert np.all(np.diff(mesh.layer) >= 0)
    g = geometry
    expected = 0.5 * np.pi * (g.half_width * g.half_height - g.cavity**2 * g.bone_half_width * g.bone_half_height)
    assert mesh.points.weights.sum() == pytest.approx(expected, rel=2e-3)


def test_ridges_modulate_the_pad_only() -> None:
    smooth, rough = FingerGeometry(ridge_height=1e-9).build(), FingerGeometry().build()
    depth = np.linalg.norm(smooth.nodes - rough.nodes, axis=1)
    assert depth.max() == pytest.approx(0.1e-3, rel=0.02)
    assert np.all(depth[rough.nodes[:, 1] < 0.0] == 0.0)


def test_sensitivities_agree_with_differences_and_name_the_soft_layers() -> None:
    run, symbols = suction(), MODEL.info.symbols
    result = MODEL.simulate(run, {}, symbols)
    assert result.sensitivities is not None
    rise = result.channels["deflection"][-1]
    share = []
    for j, symbol in enumerate(symbols):
        value = MODEL.info.defaults[symbol]
        exact = result.sensitivities["deflection"][-1, j]
        share.append(exact * value / rise)
        if symbol in ("subcutis.E", "epidermis.E"):
            up, down = (MODEL.simulate(run, {symbol: value * f}).channels["deflection"][-1] for f in (1.005, 0.995))
            assert exact == pytest.approx((up - down) / (0.01 * value), rel=2e-3)
    by = dict(zip(symbols, share, strict=True))
    assert by["subcutis.E"] < by["epidermis.E"] < -0.05
    assert abs(by["bone.E"]) < 1e-3
    assert -1.1 < sum(share) < -0.7  # −1 in the small-strain limit: the deflection is a load over a modulus


def test_support_and_mesh() -> None:
    base = MODEL.simulate(suction(ridge_height=0.0), {}).channels["deflection"][-1]
    on_bone = MODEL.simulate(suction(ridge_height=0.0, support="bone"), {}).channels["deflection"][-1]
    finer = MODEL.simulate(suction(ridge_height=0.0, mesh=1.5), {}).channels["deflection"][-1]
    assert 0.9 * base < on_bone < base  # held at the bone, nothing yields behind it
    assert finer == pytest.approx(base, rel=0.02)  # the rim's sharp edge converges slowly


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ({"ridges": 1}, "no geometry option 'ridges'"),
        ({"support": "hand"}, "'nail' or 'bone'"),
        ({"dermis": 6e-3}, "no room for subcutis"),
        ({"opening": 7e-3}, "beyond the pad"),
        ({"mesh": 0.0}, "mesh must be positive"),
    ],
)
def test_wrong_options_are_named(geometry: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MODEL.simulate(suction(**geometry), {})
