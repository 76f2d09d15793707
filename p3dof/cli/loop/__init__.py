"""`p3dof loop`: any robot with closed loops on the command line; nothing of the machine is loaded for it."""

from p3dof.cli.app import Group, app

COMMANDS = {
    "Model": {
        "info": ("p3dof.cli.loop.robot", "Show joints, loop closures and mobility."),
        "assemble": ("p3dof.cli.loop.robot", "Close the loops at values of the actuated joints."),
    },
    "Dynamics": {
        "forces": ("p3dof.cli.loop.forces", "Compute the actuator forces over a motion."),
        "simulate": ("p3dof.cli.loop.simulate", "Simulate a robot, under control or constant forces."),
    },
    "Measure": {
        "excite": ("p3dof.cli.loop.identify", "Optimise an excitation motion for identification."),
        "identify": ("p3dof.cli.loop.identify", "Identify inertia and friction from a log."),
        "calibrate": ("p3dof.cli.loop.identify", "Calibrate lengths and encoders from measured poses."),
    },
    "See and export": {
        "show": ("p3dof.cli.loop.show", "Show a robot and its forces in the browser."),
        "export": ("p3dof.cli.loop.export", "Write a robot as URDF, MJCF, SDF, glTF or ROS package."),
        "codegen": ("p3dof.cli.loop.codegen", "Generate C99 code of the dynamics, loops included."),
    },
}
"""As `p3dof.cli.app.COMMANDS`."""


@app.group(cls=Group, table=COMMANDS)
def loop() -> None:
    """Any closed-loop robot: assembly, actuator forces, simulation, export, C code.

    FILE is a URDF (or its .xacro), URDF+, SDF, MJCF or USDA file, or the name of a robot: of the gallery
    that comes with p3dof, such as stewart, or of example-robot-data. SIDECAR is a YAML file with its loop
    closures and actuated joints, by default the one beside FILE.
    """


__all__ = ["loop"]
