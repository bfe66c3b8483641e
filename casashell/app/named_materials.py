"""Sheet materials by name, from published numbers where there are some, else typical ones.

Rigidity of a homogeneous sheet is E t^3 / 12.  Values are typical of one sheet each; other sheets of the
same name differ by a factor of two or more, and woven cloth differs by as much along its two threads.

silk     14 momme = 60 g/m2; 0.015 gf cm2/cm = 1.5 uN m is typical of thin dress fabrics in the Kawabata
         test, and so is a stretch of 2 % under 0.5 N/cm; no single published sheet
cotton   plain weave of 0.15 kg/m2 (Penava et al. 2014, Fibres & Textiles in Eastern Europe 22(2),
         Table 1); 0.06 gf cm2/cm = 6 uN m and 4 % under 5 N/cm are typical of shirting
denim    11 oz black denim of Wang, O'Brien and Ramamoorthi 2011, ACM Trans. Graph. 30(4): 0.324 kg/m2,
         64 uN m, 2.0 kN/m at small strain.  Light summer denim measures 14-22 uN m (Journal of
         Textiles 2016, 4614168, Table 5)
felt     pressed wool 3 mm thick of 200 kg/m3 with E = 1 MPa, typical of soft technical felt
leather  chrome-tanned, 1.2 mm, 800 kg/m3, E = 20 MPa at small strain, typical of garment leather
paper    printing paper 0.11 mm thick with E = 2.9 GPa (Scientific Reports 4, 6275, Table 2), 80 g/m2
rubber   soft natural rubber, 1 mm, 1000 kg/m3, E = 1.5 MPa

Friction on skin: cloth 0.3 on the forearm to 0.9 on the chest (cotton; Temel, Johnson and Lloyd 2022,
Tribology Letters 70); the others are ranges in use and no more than a guide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Sheet:
    """Density [kg/m2], membrane stiffness Y [N/m], bending rigidity B [N m], friction on skin."""

    name: str
    density: float
    membrane: float
    rigidity: float
    friction: tuple[float, float]


def _homogeneous(
    name: str, thickness: float, mass: float, modulus: float, friction: tuple[float, float]
) -> Sheet:
    """A sheet of thickness [m], mass [kg/m2] and Young's modulus [Pa]."""
    return Sheet(name, mass, modulus * thickness, modulus * thickness**3 / 12.0, friction)


#: From soft to stiff for their weight.
SHEETS: Final = (
    Sheet("silk", 0.06, 2.5e3, 1.5e-6, (0.2, 0.4)),
    Sheet("cotton", 0.15, 1.25e4, 6e-6, (0.3, 0.9)),
    _homogeneous("rubber sheet", 1e-3, 1.0, 1.5e6, (0.6, 1.2)),
    Sheet("denim", 0.324, 2.0e3, 6.4e-5, (0.3, 0.9)),
    _homogeneous("leather", 1.2e-3, 0.96, 20e6, (0.4, 0.8)),
    _homogeneous("wool felt", 3e-3, 0.6, 1e6, (0.4, 0.7)),
    _homogeneous("paper", 1.1e-4, 0.08, 2.92e9, (0.2, 0.5)),
)
