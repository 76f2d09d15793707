"""Generated C: written, compiled and called."""

from __future__ import annotations

import ctypes
import subprocess
from dataclasses import dataclass, replace

import numpy as np
import pytest
from compilers import CC
from machines import random_actuators, random_friction, random_machine

from p3dof._base.files import write_generated
from p3dof.cli import main
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced.dynamics import JOINTS
from p3dof.codegen import controller
from p3dof.codegen.controller import controller_files, prototypes
from p3dof.codegen.machine import ACTUATORS
from p3dof.codegen.routines import routines
from p3dof.machine.parameters import LINKS, PAPER, SLIDES, SOLIDS

WARNINGS = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion")
STRICT = ("-Wstrict-prototypes", "-Wmissing-prototypes", "-Wcast-qual", "-Wundef", "-Wfloat-equal")
OK, NOT_FINITE, OUT_OF_REACH, SINGULAR, BAD_PARAMETERS, NULL_POINTER = range(6)
GROUPS = {name: [a.shape for a in outputs] for name, _, outputs in prototypes()}


def general(seed):
    """A machine without any symmetry, with friction and actuators."""
    rng, machine = np.random.default_rng(seed), random_machine(seed)
    own = random_actuators(np.random.default_rng(seed), machine)
    return replace(machine, friction=random_friction(rng), actuators=own)


MACHINES = {"paper": PAPER, "solids": SOLIDS, "general": general(4)}


def write(folder, machine, bake):
    write_generated(controller_files(machine, bake), folder, controller.MARK)
    return folder


def build(folder, *flags, compiler=CC, sources=("p3dof.c", "p3dof_selftest.c"), output="selftest"):
    command = [compiler, *flags, *sources, "-o", output, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / output


def run(program, *arguments):
    return subprocess.run([program, *arguments], capture_output=True, text=True, check=False)


class CBody(ctypes.Structure):
    _fields_ = (("mass", ctypes.c_double), ("com", ctypes.c_double * 3), ("inertia", ctypes.c_double * 6))

    @classmethod
    def of(cls, body):
        I = body.inertia  # noqa: E741 - the inertia
        six = (I[0, 0], I[0, 1], I[0, 2], I[1, 1], I[1, 2], I[2, 2])
        return cls(body.mass, tuple(body.com), six)


class CParameters(ctypes.Structure):
    _fields_ = (
        ("r", ctypes.c_double),
        ("R", ctypes.c_double),
        ("L", ctypes.c_double),
        ("b", ctypes.c_double),
        ("gravity", ctypes.c_double * 3),
        ("bodies", CBody * len(LINKS)),
        ("viscous", ctypes.c_double * len(JOINTS)),
        ("coulomb", ctypes.c_double * len(JOINTS)),
        ("smoothing", ctypes.c_double),
        ("travel", ctypes.c_double * 2),
        ("speed", ctypes.c_double),
        ("force", ctypes.c_double),
        ("tilt", ctypes.c_double * 2),
        *((kind, ctypes.c_double * 3) for kind in ACTUATORS),
    )

    @classmethod
    def of(cls, machine):
        g, friction = machine.geometry, machine.friction
        bodies = (CBody * len(LINKS))(*(CBody.of(body) for _, body in machine.bodies.items()))
        viscous, coulomb = (
            (ctypes.c_double * len(JOINTS))(*(given.get(name, 0.0) for name in JOINTS))
            for given in (friction.viscous, friction.coulomb)
        )
        gravity = (ctypes.c_double * 3)(*machine.gravity)
        found = cls(g.r, g.R, g.L, g.b, gravity, bodies, viscous, coulomb, friction.smoothing)
        limits = machine.limits
        found.travel[:], found.tilt[:] = limits.travel, limits.tilt
        found.speed, found.force = limits.speed, limits.force
        for kind in ACTUATORS:
            getattr(found, kind)[:] = [getattr(machine.actuators, kind).get(slide, 0.0) for slide in SLIDES]
        return found


class CModel(ctypes.Structure):
    _fields_ = (
        ("numbers", ctypes.c_double * len(MODEL)),
        ("constants", ctypes.c_double * len(routines().constants())),
        ("limits", ctypes.c_double * 6),
        ("friction", ctypes.c_uint),
    )


@dataclass
class Library:
    """A compiled library; `call` takes the model of a machine, or None where it is baked in."""

    c: ctypes.CDLL

    def prepare(self, machine):
        model = CModel()
        assert self.c.p3dof_prepare(ctypes.byref(CParameters.of(machine)), ctypes.byref(model)) == OK
        return model

    def status(self, name, model, *inputs):
        outputs = [np.full(shape, 77.0) for shape in GROUPS[name]]
        arrays = [None if x is None else np.ascontiguousarray(x, dtype=float) for x in inputs]
        first = [] if model is None else [ctypes.byref(model)]
        places = [None if x is None else x.ctypes.data_as(ctypes.c_void_p) for x in (*arrays, *outputs)]
        status = getattr(self.c, f"p3dof_{name}")(*first, *places)
        if status != OK:
            assert all((output == 77).all() for output in outputs)
        return status, outputs

    def call(self, name, model, *inputs):
        status, outputs = self.status(name, model, *inputs)
        assert status == OK
        return outputs if len(outputs) > 1 else outputs[0]

    def rows(self, name, model, *columns):
        """Call for every row; return all outputs of a sample in a row."""
        count = len(columns[0])
        rows = [self.call(name, model, *(c if c is None else c[i] for c in columns)) for i in range(count)]
        return np.array(
            [np.concatenate([np.ravel(x) for x in (r if isinstance(r, list) else [r])]) for r in rows]
        )


def load_library(folder):
    flags = ("-std=c99", "-O1", "-fPIC", "-shared")
    return Library(ctypes.CDLL(str(build(folder, *flags, sources=("p3dof.c",), output="libp3dof.so"))))


def library_of_any_machine(folder):
    """The library that takes any machine at run time."""
    if CC is None:
        pytest.skip("no C compiler here")
    return load_library(write(folder, PAPER, bake=False))


def codegen_command(capsys, *arguments):
    code = main(["codegen", *(str(argument) for argument in arguments)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def one_line(code, err):
    assert code == 2
    assert err.startswith("p3dof: error: ")
    assert len(err.splitlines()) == 1
    assert "Traceback" not in err
