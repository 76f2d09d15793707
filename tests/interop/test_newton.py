"""Newton: `builder.add_urdf("urdf/p3dof.urdf")`, or with its loops `builder.add_usd("urdf/p3dof.usda")`."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from reference import (
    FILES,
    GRAVITY,
    LINKS,
    MECHANISM,
    MOVING,
    closed_joints,
    later,
    placements,
    random_joints,
)

import p3dof

wp = later("warp", "Newton not installed: pip install 'p3dof[interop]'")
newton = later("newton", "Newton not installed: pip install 'p3dof[interop]'")

READERS = ["urdf", "usda"]
BODIES = {"urdf": list(LINKS), "usda": [name for name in LINKS if name not in MECHANISM.markers]}
SINGLE = 2e-7  # single precision, relative


pytestmark = pytest.mark.usefixtures("warp_cache")


@cache
def machine(reader):
    builder = newton.ModelBuilder()
    if reader == "usda":
        pytest.importorskip("pxr", reason="usd-core not installed: pip install 'p3dof[usd]'")
        builder.add_usd(str(FILES / "p3dof.usda"))
    else:
        builder.add_urdf(str(FILES / "p3dof.urdf"))
    return builder.finalize(device="cpu")


def names(labels):
    return [label.split("/")[-1] for label in labels]


def by_body(model, values):
    return dict(zip(names(model.body_label), values.numpy().astype(float), strict=True))


def matrix(transform):
    """4 × 4 of Newton's position and quaternion x, y, z, w."""
    result = np.eye(4)
    result[:3, :3] = pin.Quaternion(*transform[[6, 3, 4, 5]]).normalized().toRotationMatrix()
    result[:3, 3] = transform[:3]
    return result


def state_at(model, q):
    """The state at joint values by name; the coordinates of the loops' own joints follow from it."""
    state = model.state()
    values = model.joint_q.numpy().copy()  # on the CPU it is the model's own memory
    starts = dict(zip(names(model.joint_label), model.joint_q_start.numpy(), strict=False))
    for name, value in q.items():
        values[starts[name]] = value
    joint_q = wp.array(values, dtype=float, device="cpu")
    newton.eval_fk(model, joint_q, model.joint_qd, state)
    return state


def gaps(model, state):
    """Distance between the two halves of every loop joint: those of no articulation."""
    at = [matrix(row) for row in state.body_q.numpy().astype(float)]
    found = []
    for joint in np.flatnonzero(model.joint_articulation.numpy() < 0):
        parent, child = model.joint_parent.numpy()[joint], model.joint_child.numpy()[joint]
        one = at[parent] @ matrix(model.joint_X_p.numpy()[joint].astype(float))
        other = at[child] @ matrix(model.joint_X_c.numpy()[joint].astype(float))
        found.append(float(np.linalg.norm(one[:3, 3] - other[:3, 3])))
    assert len(found) == len(MECHANISM.closures)
    return found


@cache
def composites():
    """Inertias by link, markers included with their carriers: what Pinocchio makes of the URDF."""
    model = pin.buildModelFromUrdf(str(FILES / "p3dof.urdf"))
    root = LINKS["base_link"].body
    found = {"base_link": pin.Inertia(root.mass, root.com, root.inertia)}
    return found | {joint.child: model.inertias[model.getJointId(name)] for name, joint in MOVING.items()}


def expected(reader):
    if reader == "usda":
        return composites()
    return {
        name: pin.Inertia(link.body.mass, link.body.com, link.body.inertia) for name, link in LINKS.items()
    }


@pytest.mark.parametrize("reader", READERS)
def test_every_body_weighs_the_same(reader):
    model = machine(reader)
    bodies = expected(reader)
    masses, centers, inertias = (
        by_body(model, values) for values in (model.body_mass, model.body_com, model.body_inertia)
    )
    assert sorted(masses) == sorted(BODIES[reader])
    for name, body in bodies.items():
        np.testing.assert_allclose(masses[name], body.mass, rtol=SINGLE, err_msg=name)
        np.testing.assert_allclose(centers[name], body.lever, rtol=SINGLE, atol=1e-9, err_msg=name)
        scale = np.abs(body.inertia).max()
        np.testing.assert_allclose(
            inertias[name], body.inertia, rtol=0, atol=2 * SINGLE * scale, err_msg=name
        )
    total = MECHANISM.mass + LINKS["base_link"].body.mass
    assert sum(masses.values()) == pytest.approx(total, rel=SINGLE)


@pytest.mark.parametrize("reader", READERS)
def test_joints_have_the_same_names_types_and_limits(reader):
    model = machine(reader)
    labels = names(model.joint_label)
    kinds = [newton.JointType(int(kind)).name.lower() for kind in model.joint_type.numpy()]
    starts = model.joint_qd_start.numpy()
    found = dict(zip(labels, zip(kinds, starts, strict=False), strict=True))
    tree = {n for n, free in zip(labels, model.joint_articulation.numpy() < 0, strict=True) if not free}
    fixed = {joint.name for joint in MECHANISM.markers.values()}
    extra = {"urdf": {"fixed_base", *fixed}, "usda": {"base_link_fixed"}}
    assert tree == {*MOVING, *extra[reader]}
    limits = {
        "lower": model.joint_limit_lower.numpy(),
        "upper": model.joint_limit_upper.numpy(),
        "velocity": model.joint_velocity_limit.numpy(),
        "effort": model.joint_effort_limit.numpy(),
    }
    for name, joint in MOVING.items():
        kind, at = found[name]
        assert kind == joint.kind
        for limit, values in limits.items():
            if limit == "effort" and reader == "usda" and name not in MECHANISM.actuated:
                continue  # USD limits the force of a drive; these joints have none
            assert values[at] == pytest.approx(getattr(joint.limits, limit), rel=SINGLE)


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_they_should_be(reader, seed):
    model = machine(reader)
    q = random_joints(seed)
    found = by_body(model, state_at(model, q).body_q)
    reference = placements(q)
    assert sorted(found) == sorted(BODIES[reader])
    for name, row in found.items():
        np.testing.assert_allclose(matrix(row), reference[name], rtol=0, atol=2e-6, err_msg=name)


def test_gravity_comes_with_the_stage():
    np.testing.assert_allclose(np.ravel(machine("usda").gravity.numpy())[:3], GRAVITY, rtol=SINGLE)


@pytest.mark.parametrize("reader", READERS)
def test_every_solid_is_there(reader):
    model = machine(reader)
    assert model.shape_count == sum(len(link.visuals) + len(link.collisions) for link in LINKS.values())


def test_urdf_keeps_the_parallelogram_as_a_mimic():
    model = machine("urdf")
    labels = names(model.joint_label)
    coefficients = model.joint_mimic_coeffs.numpy()
    found = {
        labels[joint]: (labels[leader], *coefficients[joint])
        for joint, leader in enumerate(model.joint_mimic_joint.numpy())
        if leader >= 0
    }
    mimics = {name: joint.mimic for name, joint in MOVING.items() if joint.mimic is not None}
    assert found == {name: (mimic.joint, 0, mimic.multiplier) for name, mimic in mimics.items()}


@pytest.mark.slow
def test_usd_keeps_the_loops():
    model = machine("usda")
    loops = np.flatnonzero(model.joint_articulation.numpy() < 0)
    assert [names(model.joint_label)[loop] for loop in loops] == [c.name for c in MECHANISM.closures]
    assert {newton.JointType(int(model.joint_type.numpy()[loop])) for loop in loops} == {
        newton.JointType.BALL
    }
    for q in closed_joints(10):
        assert max(gaps(model, state_at(model, q))) < 1e-6
    for seed in range(3):
        assert min(gaps(model, state_at(model, random_joints(seed)))) > 1e-3


def pushed(forces, duration, step):
    """Joint values by our own forward dynamics, from rest at home, by semi-implicit Euler steps."""
    loop = p3dof.load().loop
    q, v = np.zeros((2, loop.model.nv))
    for _ in range(round(duration / step)):
        v = v + step * loop.forward_dynamics(loop.assemble(None, guess=q).q, v, forces).a
        q = q + step * v
    return dict(zip(list(loop.model.names)[1:], q, strict=True))


@pytest.mark.slow
def test_loops_stay_closed_and_move_as_ours_do():
    """Kamino (maximal coordinates, semi-implicit Euler): 30 ms from rest under unequal forces.

    Against our forward dynamics by the same scheme: 5e-5 m of 7e-3 m at 1 ms, 1.6e-5 m at .5 ms. Both are
    first order in the step: 2.4e-4 m and 1.2e-4 m from the motion that Runge and Kutta give.
    """
    model = machine("usda")
    solver = newton.solvers.SolverKamino(model)
    weights = p3dof.load().loop.inverse_dynamics(*np.zeros((3, len(MOVING)))).tau
    forces = weights + np.array([100.0, -50.0, 75.0])
    duration, step = 0.03, 1e-3
    state, following, control = state_at(model, {}), model.state(), model.control()
    starts = dict(zip(names(model.joint_label), model.joint_qd_start.numpy(), strict=False))
    joint_f = np.zeros(model.joint_dof_count, dtype=np.float32)
    for name, force in zip(MECHANISM.actuated, forces, strict=True):
        joint_f[starts[name]] = force
    control.joint_f.assign(joint_f)
    widest = 0.0
    for _ in range(round(duration / step)):
        state.clear_forces()
        solver.step(state, following, control, None, step)
        state, following = following, state
        widest = max(widest, *gaps(model, state))
    assert widest < 3e-5  # measured: 1e-5
    q = pushed(forces, duration, step)
    assert max(abs(q[name]) for name in MECHANISM.actuated) > 5e-3
    reference, found = placements(q), by_body(model, state.body_q)
    for name, row in found.items():
        np.testing.assert_allclose(row[:3], reference[name][:3, 3], rtol=0, atol=1e-4, err_msg=name)
