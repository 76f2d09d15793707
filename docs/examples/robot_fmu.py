"""FMUs of a robot with its controller, for FMI 2.0 and 3.0: `python docs/examples/robot_fmu.py out`."""

import sys
from copy import copy
from pathlib import Path
from xml.etree.ElementTree import SubElement

import pythonfmu as fmi2
import pythonfmu3 as fmi3
import robot_in_steps
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability


class Machine:
    """The targets of the motors go in; their positions, speeds and torques come out."""

    def prepare(self, number, causality):
        direction = causality.output, causality.input
        self.robot = robot_in_steps.RobotInSteps(Path(self.resources) / robot_in_steps.FILES[0].name)
        for i, name in enumerate(self.robot.loop.actuated):
            for of in ("target", "position", "speed", "torque"):
                variable = number(f"{of}.{name}", causality=direction[of == "target"])
                variable.getter = lambda of=of, i=i: getattr(self.robot, of)[i]
                if of == "target":
                    variable.setter = lambda value, i=i: self.robot.target.__setitem__(i, value)
                self.register_variable(variable)

    def exit_initialization_mode(self):
        self.robot.look()

    def do_step(self, current_time, step_size):
        return self.robot.step(step_size)


class FiveBar2(Machine, fmi2.Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.prepare(fmi2.Real, fmi2.Fmi2Causality)

    def to_xml(self, *options):
        root = super().to_xml(*options)  # without what FMI 2.0 wants to know about the outputs' first values
        structure = root.find("ModelStructure")
        SubElement(structure, "InitialUnknowns").extend(map(copy, structure.find("Outputs")))
        return root


class FiveBar3(Machine, Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        options = {"causality": Fmi3Causality.independent, "variability": Fmi3Variability.continuous}
        self.register_variable(fmi3.Float64("time", getter=lambda: self.robot.time, **options))
        self.prepare(fmi3.Float64, Fmi3Causality)


def build(folder, files=(*robot_in_steps.FILES, robot_in_steps.__file__)):
    return [lib.FmuBuilder.build_FMU(__file__, folder, files) for lib in (fmi2, fmi3)]


if __name__ == "__main__":
    print(*build(*sys.argv[1:2] or ["out"]), sep="\n")
