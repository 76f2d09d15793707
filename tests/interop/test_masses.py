"""The masses given to massless links change no force, and every link of the file is a physical body."""

from dataclasses import replace

import numpy as np
import pytest
from machines import random_machine, random_states, virtual_power_forces
from reference import FILES, LINKS, URDF

import p3dof
from p3dof._base.errors import ModelError
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.machine import description
from p3dof.machine.motion import states_of
from p3dof.machine.parameters import PAPER, SOLIDS, Bodies, Body, Geometry
from p3dof.methods.pinocchio import PinocchioMethod


def loop_of(parameters, exact=False):
    texts = description.texts(parameters, exact=exact)
    loop = ClosedLoopModel.from_urdf(
        texts["p3dof.urdf"], Sidecar.parse(texts["p3dof.yaml"], "sidecar"), mimic=False
    )
    loop.model.gravity.linear = parameters.gravity
    return loop


def difference(parameters, states, loop=None):
    """Largest difference from the virtual-power forces, as a share of the largest force."""
    loop = loop_of(parameters) if loop is None else loop
    rows = states.pose, states.velocity, states.acceleration
    found = PinocchioMethod(parameters, loop).forces(states_of(*rows))
    expected = virtual_power_forces(parameters, *rows)
    return np.abs(found - expected).max() / np.abs(expected).max()


def scaled(parameters, factor):
    """The same machine of the same density, larger or smaller."""
    geometry = Geometry(**{name: factor * value for name, value in vars(parameters.geometry).items()})
    bodies = {
        name: Body(body.mass * factor**3, body.com * factor, body.inertia * factor**5)
        for name, body in parameters.bodies.items()
    }
    return replace(parameters, geometry=geometry, bodies=Bodies(**bodies))


def links_of(parameters):
    return description.with_masses(description.describe(parameters)).links


def assert_physical(links):
    for link in links:
        assert link.body.mass > 0, link.name
        low, middle, high = np.linalg.eigvalsh(link.body.inertia)
        assert low > 0, link.name
        assert high <= (low + middle) * (1 + 1e-12), link.name


def test_the_committed_file_has_the_papers_forces():
    loop = ClosedLoopModel.from_urdf(URDF, FILES / "p3dof.yaml", mimic=False)
    loop.model.gravity.linear = PAPER.gravity  # a URDF has no place for it
    assert difference(PAPER, p3dof.paper_motion(1001), loop) < 1e-12


def test_every_link_of_the_committed_file_is_a_physical_body():
    assert_physical(LINKS.values())
    assert min(link.body.mass for link in LINKS.values()) == pytest.approx(1e-3)
    assert sum(link.body.mass for name, link in LINKS.items() if name != "base_link") == pytest.approx(
        PAPER.bodies.mass, rel=1e-14
    )
    # Newton silently changes moments below about 3e-10 kg m².
    assert min(np.linalg.eigvalsh(link.body.inertia).min() for link in LINKS.values()) > 3e-10


@pytest.mark.parametrize("factor", [0.1, 1, 3])
@pytest.mark.parametrize("base", [PAPER, SOLIDS], ids=["paper", "solids"])
def test_machines_of_other_sizes_keep_their_forces(base, factor):
    parameters = scaled(base, factor)
    assert_physical(links_of(parameters))
    assert difference(parameters, random_states(parameters, 1, 30)) < 1e-12


@pytest.mark.parametrize("seed", range(0, 45, 9))
def test_random_machines_keep_their_forces_or_say_why_not(seed):
    """Clouds of few points, at the border of the physical: some cannot give a point mass away."""
    parameters = random_machine(seed)
    states = random_states(parameters, seed, 6)
    assert parameters.bodies.crossbar_upper.mass == 0
    assert difference(parameters, states, loop_of(parameters, exact=True)) < 1e-10
    try:
        links = links_of(parameters)
    except ModelError as error:
        assert "cannot take its mass from its neighbours exactly" in str(error)  # noqa: PT017 - either is right
        assert "write the exact variant" in str(error)  # noqa: PT017
        return
    assert_physical(links)
    assert difference(parameters, states) < 1e-10


def test_most_random_machines_do():
    def accepted(seed):
        try:
            return bool(links_of(random_machine(seed)))
        except ModelError:
            return False

    assert sum(accepted(seed) for seed in range(60)) >= 45


def with_rods(mass, inertia):
    rod = Body(mass, [0.2, 0, 0], inertia)
    return replace(PAPER, bodies=replace(PAPER.bodies, rod_left=rod, rod_right=rod))


@pytest.mark.parametrize(("mass", "upper"), [(0.24, 0.24 / 40), (0.8, 0.02), (1.0, 0.02)])
def test_a_cross_bar_takes_twenty_grams_or_a_fortieth_of_a_light_rod(mass, upper):
    """Half of it from each rod, the lower bar after the upper one; a marker takes a gram or a twentieth."""
    parameters = with_rods(mass, [1e-3, 2e-3, 2e-3])
    mechanism = description.with_masses(description.describe(parameters))
    masses = {link.name: link.body.mass for link in mechanism.links}
    lower = min(0.02, (mass - upper / 2) / 40)
    assert masses["crossbar_upper"] == pytest.approx(upper, rel=1e-12)
    given = {"rod_left": mass, "rod_right": mass, "crossbar_lower": 0.0}
    for name in ("rod_left", "rod_right"):
        given[name] -= (upper + lower) / 2
    given["crossbar_lower"] += lower
    for marker, joint in mechanism.markers.items():
        if joint.parent in given:
            assert masses[marker] == pytest.approx(min(1e-3, given[joint.parent] / 20), rel=1e-12)
            given[joint.parent] -= masses[marker]
    assert {name: masses[name] for name in given} == pytest.approx(given, rel=1e-12)
    assert difference(parameters, random_states(parameters, 1, 5)) < 1e-12


def test_rods_that_cannot_give_mass_at_their_ends_are_refused():
    parameters = with_rods(1.0, [0, 0, 0])
    with pytest.raises(ModelError, match=r"cannot take its mass .*rod_left.*write the exact variant"):
        description.texts(parameters)
    assert difference(parameters, random_states(PAPER, 1, 5), loop_of(parameters, exact=True)) < 1e-12


@pytest.mark.parametrize(
    ("mass", "inertia"),
    [
        (1e-3, [6e-7, 1.3e-5, 1.3e-5]),
        (1e-6, [1e-10, 1e-8, 1e-8]),
        (1.0, [1e-4, 1e-4, 1e-4]),
        (0.1, [1e-6, 1e-6, 1e-6]),
    ],
)
def test_light_rods_give_less(mass, inertia):
    parameters = with_rods(mass, inertia)
    assert_physical(links_of(parameters))
    assert difference(parameters, random_states(PAPER, 1, 5)) < 1e-12


def test_rods_without_inertia_about_their_axis_are_refused():
    """What a slender rod of the textbook is: nothing is there to give to the cross-bar."""
    with pytest.raises(ModelError, match="slender"):
        description.texts(with_rods(1.0, [0, 0.0133, 0.0133]))


def test_the_exact_variant_has_the_massless_links():
    loop = loop_of(PAPER, exact=True)
    text = description.texts(PAPER, exact=True)["p3dof.urdf"]
    assert text.count("<inertial>") == 8  # sliders, legs, rods, platform
    assert text.count("<link ") == 18
    assert difference(PAPER, random_states(PAPER, 1, 30), loop) < 1e-12
