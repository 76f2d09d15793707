"""Dynamics of any robot with loop closures, on Pinocchio: a tree URDF and a sidecar with its closures.

`ClosedLoopModel` is the entry: `assemble` closes the loops at a target, `complete` adds the velocity and the
acceleration of the whole tree, `inverse_dynamics` and `forward_dynamics` follow. Redundant closures and
redundant actuators are welcome; every result carries its own residuals, and what did not converge raises.
This layer knows no particular mechanism. Each name is imported when it is first used.

Where to look, from what a user has to what is computed:

- files: `robots` (`load_robot`), `formats` (URDF, URDF+, MJCF, SRDF, names, Pinocchio's own models),
  `sidecar` (closures, couplings, data of joints), `writers`;
- the tree: `trees` (joints locked, too), `coordinates` (joints, rotations, springs, damping, friction),
  `bushings`, `tree_formulas` (for tapes);
- closures: `closures` evaluates them and couplings, `closure_kinds` those that Pinocchio does not know;
  `closure_joints` has the forces in them in space;
- closing loops: `assembly`, with targets and what solves;
- dynamics: `inverse`, `forward`, `hybrid` with their `results`; `partitions` and `linear` solve;
  `reactions`, with `compliance` of elastic joints;
- equations of motion: `minimal` (independent coordinates), `margins`, `derivatives` with `*_tangents`,
  `regressor` (and base parameters);
- the class: `loop_model` is the door for one configuration, `model` (`ClosedLoopModel`) adds many samples, C
  and files. Behind them stand a robot in one unit of length (`closed_tree`), the modules above, and
  `compiled.kept` (``method="compiled"``); `units` serves robots much smaller or larger than a
  metre, and is the only place where numbers change their unit;
- from joints to the actuators behind linkages: `transmission`; external forces from theirs: `observer`;
  payloads in a control loop: `online`;
- many samples: `batch`; in C: `compiled`, with the simulations that `p3dof.runs` makes.
"""

from p3dof._base import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
