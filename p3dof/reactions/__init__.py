"""Reactions in every joint of the manipulator over a motion: what its bearings and guides have to bear.

Thirteen joints: the ten of the tree, and the three where its loops were cut. How the cuts are built decides
which moments they transmit:

``"paper"``
    Legs A and B meet the platform in universal joints, with the leg's hinge axis and the platform's y axis;
    the right rod meets the lower cross-bar in a hinge. 13 components on 7 constraints: 6 are left open.
``"points"``
    The cuts are ball joints, as they are in the model. 9 components on 7 constraints: 2 are left open.

What is left open, rigid bodies do not tell: it depends on stiffness, play and assembly. Such components are
marked in every sample, and have the values that belong to the smallest forces at the cuts (see
`p3dof.closed_loop.reactions`). That is a choice, not an estimate: with ``"paper"``, for example, it lets the
left rod bear nearly all of the parallelogram's axial load, since only the right one ends in a cut. A bearing
that is sized by a marked number needs a look at what else its joint could bear.

Friction of the joints is part of their reactions, and lies along their freedoms.
"""

from p3dof.reactions.evaluation import of_solution, over_motion
from p3dof.reactions.joints import IDEALISATIONS, JOINTS, Idealisation, Joint
from p3dof.reactions.one_joint import JointReaction, Peak
from p3dof.reactions.results import Reactions

__all__ = [
    "IDEALISATIONS",
    "JOINTS",
    "Idealisation",
    "Joint",
    "JointReaction",
    "Peak",
    "Reactions",
    "of_solution",
    "over_motion",
]
