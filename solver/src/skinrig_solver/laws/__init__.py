"""The hyperelastic laws of a sheet of skin: one file of formulas each.

To add one, write its file after the shortest example, yeoh.py: an ``energy`` and a compiled ``point`` function with
stress, tangent and parameter derivatives (helpers in tensors.py), and a ``Law`` that names its parameters.
Enter it in ``LAWS`` here and as ``sheet_<name>`` in ``skinrig_solver.registry``.
The tests of tests/laws then check its derivatives; test_energies.py there takes its energy for an independent stress.
"""

from .bischoff import BISCHOFF
from .fung import FUNG
from .gasser import GASSER
from .law import Law
from .ogden import OGDEN
from .tong_fung import TONG_FUNG
from .yeoh import YEOH

LAWS: dict[str, Law] = {law.name: law for law in (OGDEN, TONG_FUNG, BISCHOFF, FUNG, GASSER, YEOH)}

__all__ = ["LAWS", "Law"]
