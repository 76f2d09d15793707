"""Reactions in every joint of the manipulator over a motion: what its bearings and guides have to bear.

Thirteen joints: the ten of the tree, and the three where its loops were cut. How the cuts are built decides
which moments they transmit:

``"paper"``
    Legs A and B meet the platform in universal joints, with the leg's hinge axis and the platform's y axis;
    the right rod meets the lower cross-bar in a hinge. 13 components on 7 constraints: 6 are left open.
``"points"``
    The cuts are ball joints, as they are in the model. 9 components on 7 constraints: 2 are left open.

What is left open, rigid bodies do not tell: it depends on stiffness, play and assembly. Such components are
marked in every sample. There are three ways to them:

``"elastic"``
    Joints and rods give way as a `Stiffness` says, between rigid bodies and without play; of all possible
    reactions those bear the load whose complementary energy is smallest (`p3dof.loops.compliance`).
    This is what to size joints for, and as good as the stiffnesses; see `Stiffness`, whose numbers by default
    are guesses. What an assembly error adds comes with it. The half width b of the parallelogram, which
    decides no actuator force and stands in no paper, decides the loads of its rods.
``"paper"``, ``"points"``
    The cuts built so, those reactions that have the smallest sum of squares over all joints, moments taken as
    forces on an arm of L/20 (20 mm in the paper's machine, the diameter of its rods). It is a choice, not an
    estimate, not even alike for left and right, and neither is a bound: stiffness leads to loads outside
    both. They are shown beside the elastic loads, as what they are.

`Reactions.peaks` are to size joints for: with ``"paper"`` or ``"points"`` alone they leave open loads out;
`Reactions.open_peaks` has them in every way.

Friction of the joints is part of their reactions, and lies along their freedoms.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
