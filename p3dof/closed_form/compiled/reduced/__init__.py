"""The machine's dynamics in as few operations as we could find: bodies folded once into 21 numbers.

Derivation
----------
The three legs hang in *natural coordinates*: with the velocities of both ends of a rod, its kinetic energy
has constant coefficients, whatever its mass distribution. Leg A moves in the plane y, z; its upper end has
the velocity λ̇ ẑ, its lower end (ẏ, ż), so that with the mass m, the mass centre (c_x, ·, c_z) and the
inertia I about the hinge

    T = ½ a λ̇² + c λ̇ ż + ½ k (ẏ² + ż²) + d λ̇ ẏ,
    k = I / L²,   c = m c_x / L - k,   a = m - 2 m c_x / L + k,   d = -m c_z / L.

There are no Coriolis terms: the forces of inertia are these constants times λ̈, ÿ, z̈; gravity is taken off
the accelerations. The slider's mass joins a; what is at the lower end joins the platform. The two rods of leg
C move alike and are one rod with the sum of their masses, moments and inertias; the same holds for its ends,
the upper one on the slider C, the lower one at C5 = P + (-q, ·, p) with p = r sin θ, q = r cos θ. The
platform is a rod from P to C5 in the same sense (p q̈ - q p̈ cancels: its inertia and that of the mass at C5
are one).

What is left turns about y0 with the plane of the parallelogram, at the angle β from the vertical: the
cross-bars and what the rods are more than end masses. In the velocities of β and y

    T = ½ K β̇² + N β̇ ẏ + λ̇_C Ḣ,      H = h1 sin β + (h2 + h3 y) cos β,
    K = k0 + k1 y² + 2 (k2 y + k3) u,   N = n0 + n1 y / u,   u² = L² - y².

The first moments l1, l2 of the lower cross-bar would add (lower end)·(Ġ, Ḣ) with H = l1 sin β + l2 cos β and
G = ∂H/∂β. But the ends are (u sin β, -u cos β) apart, and so this is λ̇_C Ḣ + l1 (y / u) β̇ ẏ - l2 u β̇²: they
join h1 and n1, h2 and k3.

So the forces need the 21 numbers of `Reduced`; they are linear in them and need all of them: these are the
base inertial parameters of the force model. The generalized forces Q of y, z, θ (without what acts at the
sliders' own coordinates, F) are solved by hand: f = F + J⁻ᵀ Q. Neither z nor ż enters.

Motors, screws and counterbalances act at the sliders' own coordinates: an armature j adds to a and gives back
the weight that a has; a counterbalance is taken off. With a spring its force depends on λ, and so on z.

The mass matrix follows from the same energies; forward dynamics takes z out first, whose mass is constant.

`test_reduced.py` holds this against the full recursion of `p3dof.closed_form.paper.virtual_power`,
Lagrange's equations and the rank of the regressor.

References
----------
J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, Springer 1994, ch. 4
(natural coordinates). M. Gautier, W. Khalil, Direct Calculation of Minimum Set of Inertial Parameters of
Serial Robots, IEEE Trans. Robotics and Automation 6 (1990).
"""

from p3dof.closed_form.compiled.reduced.constants import (
    SMALLER_ZEROS,
    SYMMETRIC_ZEROS,
    Actuated,
    Model,
    Moments,
    Reduced,
    fold,
    fold_actuators,
    fold_moments,
    model_of,
    moments_of,
)
from p3dof.closed_form.compiled.reduced.dynamics import (
    MOVING,
    State,
    actuator_forces,
    assembled,
    coriolis_matrix,
    forward_dynamics,
    loads,
    mass_matrix,
    solve_about_z,
    solve_transposed,
    transposed,
)
from p3dof.closed_form.compiled.reduced.shapes import (
    Shape,
    limit_cosines,
    margin,
    shape,
    slider_rates,
    sliders,
)

__all__ = [
    "MOVING",
    "SMALLER_ZEROS",
    "SYMMETRIC_ZEROS",
    "Actuated",
    "Model",
    "Moments",
    "Reduced",
    "Shape",
    "State",
    "actuator_forces",
    "assembled",
    "coriolis_matrix",
    "fold",
    "fold_actuators",
    "fold_moments",
    "forward_dynamics",
    "limit_cosines",
    "loads",
    "margin",
    "mass_matrix",
    "model_of",
    "moments_of",
    "shape",
    "slider_rates",
    "sliders",
    "solve_about_z",
    "solve_transposed",
    "transposed",
]
