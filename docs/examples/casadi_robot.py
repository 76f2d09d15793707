"""A closed-loop robot as a CasADi function with its Jacobian, from the C of `p3dof loop codegen`."""

import subprocess
import sys
import tempfile
from pathlib import Path

import casadi

import p3dof

HERE = Path(__file__).parent
FUNCTIONS = "motion,step,integrate,flow,tangent_of_accelerations"


def dynamics(file, folder):
    """Return the motors' accelerations as a function of their positions and velocities, and their forces."""
    options = ("--prefix", "robot", "--functions", FUNCTIONS, "--out", folder)
    codegen = [sys.executable, "-m", "p3dof", "loop", "codegen", file, *options]
    subprocess.run(codegen, check=True, stdout=subprocess.DEVNULL)
    robot = p3dof.load_robot(file)
    joints = [robot.model.getJointId(name) for name in robot.compile().independent]
    given = {
        "AT_Q": [robot.model.idx_qs[joint] for joint in joints],
        "AT_V": [robot.model.idx_vs[joint] for joint in joints],
        "HOME": robot.assemble().q.tolist(),
    }
    macros = [f"-D{name}={{{','.join(map(repr, values))}}}" for name, values in given.items()]
    sources, library = (HERE / "casadi_robot.c", f"{folder}/robot.c"), f"{folder}/dynamics.so"
    options = ("-std=c99", "-O2", "-shared", "-fPIC", f"-I{folder}", *macros)
    subprocess.run(["cc", *options, *sources, "-lm", "-o", library], check=True)
    return casadi.external("dynamics", library)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        accelerate = dynamics("gallery/five_bar.urdf", made)
        print(accelerate)
        print(accelerate([2.0, 1.1, 0.5, -0.3], [1.0, 2.0]), "rad/s²")
        print(accelerate.jacobian()([2.0, 1.1, 0.5, -0.3], [1.0, 2.0], [])[1], "1/(kg m²)")
