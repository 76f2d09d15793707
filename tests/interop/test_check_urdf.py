"""urdfdom's own tools, Debian's liburdfdom-tools: `check_urdf urdf/p3dof.urdf`."""

import re
import shutil
import subprocess

import pinocchio as pin
import pytest
from reference import MECHANISM, URDF

MISSING = "not installed: apt-get install liburdfdom-tools"


def run(tool, *arguments, **options):
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} {MISSING}")
    return subprocess.run([tool, *arguments], capture_output=True, text=True, check=True, **options)


def test_it_finds_the_tree_and_nothing_to_complain_about():
    result = run("check_urdf", str(URDF))
    assert result.stderr == ""
    header, *lines = result.stdout.splitlines()
    assert header == "robot name is: p3dof"
    above = {0: "base_link"}
    found = set()
    for line in lines[2:]:
        indent, name = re.fullmatch(r"( *)child\(\d+\): +(\w+)", line).groups()
        above[len(indent) // 4] = name
        found.add((above[len(indent) // 4 - 1], name))
    assert lines[1] == "root Link: base_link has 3 child(ren)"
    assert found == {(joint.parent, joint.child) for joint in MECHANISM.joints}


def test_it_reads_every_joint_placement(tmp_path):
    run("urdf_to_graphviz", str(URDF), cwd=tmp_path)
    text = (tmp_path / "p3dof.gv").read_text(encoding="utf-8")
    number = r"(-?[\d.]+(?:e-?\d+)?)"
    rows = re.findall(
        rf'"(\w+)" -> "(\w+)" \[label="xyz: {number} {number} {number} \\nrpy: {number} {number} {number}"\]',
        text,
    )
    assert len(rows) == len(MECHANISM.joints)
    placements = {joint: [float(value) for value in row] for joint, _, *row in [(r[1], *r[1:]) for r in rows]}
    parents = {joint: parent for parent, joint, *_ in rows}
    for joint in MECHANISM.joints:
        assert parents[joint.name] == joint.parent
        xyz, rpy = placements[joint.name][:3], placements[joint.name][3:]
        # It prints six digits.
        assert xyz == pytest.approx(joint.placement.position, abs=1e-5)
        assert pin.rpy.rpyToMatrix(*rpy) == pytest.approx(joint.placement.rotation, abs=2e-5)
