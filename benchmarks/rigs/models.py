"""The nominal models of the benchmark's rigs, each written as its owner would from docs/gap.md: without the effect.

Used as ``--model benchmarks/rigs/models.py:Name``. Units are those of the recordings (SI).
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.rigs.nominal.drives import Cylinder, Joint, JointWithFriction, Pendulum, Servo, Stage, Tow, VoiceCoil
from benchmarks.rigs.nominal.loops import Cart, CartNet, Oscillator, Silverbox, Tank
from benchmarks.rigs.nominal.series import (
    Actuator,
    Cascade,
    Dryer,
    DryerWithDelay,
    Follower,
    Gear,
    Motor,
    Regulator,
    Shaker,
    Valve,
)
from benchmarks.rigs.nominal.static import (
    Balance,
    Bearing,
    Circuit,
    Encoder,
    LoadCell,
    Magnet,
    Piezo,
    Polymer,
    Rubber,
    Thermocouple,
    Tissue,
    TwoAxis,
)

__all__ = [
    "Actuator",
    "Balance",
    "Bearing",
    "Cart",
    "CartNet",
    "Cascade",
    "Circuit",
    "Cylinder",
    "Dryer",
    "DryerWithDelay",
    "Encoder",
    "Follower",
    "Gear",
    "Joint",
    "JointWithFriction",
    "LoadCell",
    "Magnet",
    "Motor",
    "Oscillator",
    "Pendulum",
    "Piezo",
    "Polymer",
    "Regulator",
    "Rubber",
    "Servo",
    "Shaker",
    "Silverbox",
    "Stage",
    "Tank",
    "Thermocouple",
    "Tissue",
    "Tow",
    "TwoAxis",
    "Valve",
    "VoiceCoil",
]
