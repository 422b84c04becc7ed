"""Friction and restitution of materials, with what different samples of a material differ by.

Friction is that of sliding on another dry, clean surface of a household. Sources:

- [ctu] UNECE, IMO and ILO: CTU Code, appendix 2, friction factors; three quarters of the static values, as it
  says for sliding.
- [sae] Strauss et al. 2002, SAE 2002-01-3104: pallets on a floor of hardwood, kinetic.
- [openstax] OpenStax, University Physics, volume 1, section 6.2 (CC BY 4.0): kinetic coefficients.
- [factbook] The Physics Factbook, coefficients of restitution: balls dropped on a hard floor.
- [tosses] Calibrated to the cube tosses of `unc_physics evaluate reality`.

Boxes and bottles rebound less than solid balls of their material, as edges and walls vibrate. So restitution
is a half to three quarters of that of a ball, with a standard deviation that includes the ball's.
"""

from typing import NamedTuple


class Material(NamedTuple):
    """Friction and restitution of a contact of two surfaces of a material, and their standard deviations."""

    friction: float
    friction_std: float
    restitution: float
    restitution_std: float


#: Each material by its name.
MATERIALS = {
    "aluminum": Material(0.22, 0.08, 0.35, 0.15),  # [ctu] grooved, 0.11 to 0.3
    "cardboard": Material(0.38, 0.10, 0.15, 0.10),  # [ctu] 0.38 on cardboard and on wood
    "concrete": Material(0.50, 0.10, 0.40, 0.20),  # [ctu] rough, on wood: 0.53
    "glass": Material(0.30, 0.10, 0.45, 0.20),  # between [openstax] steel and wood; [factbook] marble 0.66
    "plastic": Material(0.20, 0.06, 0.35, 0.20),  # [ctu] 0.11 to 0.15, [sae] 0.20 and 0.24, [tosses] 0.21
    "rubber": Material(0.70, 0.15, 0.60, 0.20),  # [openstax] 0.7; [factbook] rubber bands 0.83
    "steel": Material(0.25, 0.08, 0.45, 0.15),  # [ctu] 0.15 to 0.34, [openstax] 0.3; [factbook] 0.60
    "wood": Material(0.28, 0.08, 0.40, 0.15),  # [openstax] 0.3, [sae] 0.25; [factbook] 0.60
}
