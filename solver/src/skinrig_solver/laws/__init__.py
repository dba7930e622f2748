"""The hyperelastic laws of a sheet of skin: one file of formulas each.

The form is in law.py; yeoh.py is the shortest example.
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
