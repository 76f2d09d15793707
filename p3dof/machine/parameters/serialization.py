"""Parameter files: YAML in and out.

The form::

    geometry: {r: 0.1, R: 0.25, L: 0.4, b: 0.05}        # m
    bodies:
      slider:   {mass: 0.9751, com: [0, 0, 0], inertia: [4.1e-4, 4.1e-4, 4.1e-4]}   # kg, m, kg m² about com
      leg:      {...}
      crossbar: {...}
      platform: {...}
    limits: {travel: [-0.2, 0.2], speed: 2, force: 500, tilt: [-0.785, 0.785]}      # optional: m, m/s, N, rad
    gravity: [0, 0, -9.806]                                                         # optional: m/s²
    friction:                                                                       # optional
      viscous: {sliders: 20, joints: 0.01}                                          # N s/m, N m s/rad
      coulomb: {sliders: 5, hinge_platform: 0.05}                                   # N, N m
      smoothing: 0.001                                                              # m/s, rad/s
    actuators:                                                                      # optional
      armature: {sliders: 14.8}             # kg, inertia of motor and screw reflected to the slider
      counterbalance: {slide_a: 48, slide_b: 52, slide_c: 55}   # N, force on the slider along z0 at home
      spring: {slide_a: 100}                # N/m, how fast that force falls as the slider rises
      counterweight: {slide_b: 2}           # kg, on a rope over a pulley
    payload: {mass: 5, com: [0, 0, -0.1], inertia: [0.02, 0.02, 0.02]}    # optional, fixed to the platform;
                                                                          # or a list of several

``bodies`` names either these four kinds or all ten links, each on its own. An inertia is a diagonal or a full
matrix, about the mass centre; with ``about: [x, y, z]`` it is about that point instead.

Numbers are in SI units, or have one of their own, in lists each by itself::

    geometry: {r: 100 mm, R: 250 mm, L: 40 cm, b: 50 mm}
    payload: {mass: 950 g, com: [0, 0, -100 mm], inertia: [410 kg mm^2, 410 kg mm^2, 380 kg mm^2]}
    limits: {speed: 1500 mm/s, force: 0.5 kN, tilt: [-45 deg, 45 deg]}

Millimetres are not to be taken for metres: a machine whose longest length is above 20 m or below 1 mm is
refused unless the caller says ``any_size``.
"""

from __future__ import annotations

import os

import yaml

from p3dof._base.errors import ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text, suffix_of, write_atomic
from p3dof.machine.parameters.machine import Parameters


def read_parameters(path: Source, any_size: bool = False) -> Parameters:
    """Read a parameter file.

    Parameters
    ----------
    path : path-like or stream
        The YAML file. Its numbers are in SI units, or texts with a unit: ``r: 120 mm``, ``mass: 950 g``,
        ``tilt: [-45 deg, 45 deg]``, ``inertia: [410 kg mm^2, ...]``, ``force: 0.5 kN``.
    any_size : bool
        Take a machine of more than 20 m or less than 1 mm too. Such a file is usually one in millimetres.

    Returns
    -------
    parameters : Parameters

    Raises
    ------
    ParameterError
        If a field is missing, unknown, in a wrong unit or not physical, or the machine is too large or too
        small; the message names file and field.
    FileError
        If the file cannot be read.
    """
    return parse(read_text(path), called(path), any_size)


def write_parameters(parameters: Parameters, path: str | os.PathLike[str]) -> None:
    """Write a parameter file that `read_parameters` reads back to the same numbers.

    Parameters
    ----------
    parameters : Parameters
        What to write.
    path : path-like
        The YAML file; replaced whole or not at all.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If its name ends neither in ``.yaml`` nor in ``.yml``.
    ParameterError
        If `parameters` is something else.
    """
    if not isinstance(parameters, Parameters):
        raise ParameterError(f"parameters: expected Parameters, got {type(parameters).__name__}")
    suffix_of(path, "parameters")
    write_atomic(path, dump(parameters))


def parse(text: str, source: str = "parameters", any_size: bool = False) -> Parameters:
    """Read parameters from YAML text; as `Parameters.from_dict` reads plain data."""
    return Parameters.from_dict(parse_yaml(text, source, ParameterError), source, any_size)


def dump(parameters: Parameters) -> str:
    """Return the YAML text of parameters; `parse` gives the same numbers back to the last bit."""
    header = "# p3dof parameters: m, kg, kg m² about the mass centre, m/s, N, rad, m/s²\n"
    return header + yaml.safe_dump(parameters.to_dict(), sort_keys=False, default_flow_style=None, width=110)
