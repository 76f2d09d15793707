"""Reactions in every joint of the manipulator over a motion: what its bearings and guides have to bear.

Thirteen joints: the ten of the tree, and the three where its loops were cut. How the cuts are built decides
which moments they transmit:

``"paper"``
    Legs A and B meet the platform in universal joints, with the leg's hinge axis and the platform's y axis;
    the right rod meets the lower cross-bar in a hinge. 13 components on 7 constraints: 6 are left open.
``"points"``
    The cuts are ball joints, as they are in the model. 9 components on 7 constraints: 2 are left open.

What is left open, rigid bodies do not tell: it depends on stiffness, play and assembly. Such components are
marked in every sample. Of all possible reactions those are taken that have the smallest sum of squares over
all joints, moments taken as forces on an arm of L/20 (20 mm in the paper's machine, the diameter of its
rods): what joints that are all equally stiff would bear (see `p3dof.closed_loop.reactions`). With ``"paper"``
it treats left and right alike, as the machine does. It is a choice, not an estimate, and neither idealisation
is a bound: other stiffnesses lead to loads outside both. So `Reactions.peaks`, what to size joints for,
leaves open loads out; `Reactions.open_peaks` has them.

Friction of the joints is part of their reactions, and lies along their freedoms.
"""

from p3dof.reactions.comparison import UNDECIDED, AnyReactions, ReactionsComparison, how_chosen
from p3dof.reactions.evaluation import of_result, of_solution, over_motion
from p3dof.reactions.joints import BOTH, IDEALISATIONS, JOINTS, Choice, Idealisation, Joint
from p3dof.reactions.one_joint import JointLoad, JointReaction, OpenPeak, Peak
from p3dof.reactions.results import Reactions
from p3dof.reactions.tables import names_table, open_tables, reactions_table

__all__ = [
    "BOTH",
    "IDEALISATIONS",
    "JOINTS",
    "UNDECIDED",
    "AnyReactions",
    "Choice",
    "Idealisation",
    "Joint",
    "JointLoad",
    "JointReaction",
    "OpenPeak",
    "Peak",
    "Reactions",
    "ReactionsComparison",
    "how_chosen",
    "names_table",
    "of_result",
    "of_solution",
    "open_tables",
    "over_motion",
    "reactions_table",
]
