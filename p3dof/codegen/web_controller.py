"""What the WebAssembly of the manipulator offers."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from p3dof.closed_form.compiled.reduced.dynamics import JOINTS
from p3dof.codegen.controller import MARK, controller_files, origin_of, prototypes
from p3dof.codegen.machine import ACTUATORS
from p3dof.codegen.naming import PREFIX, fill
from p3dof.codegen.webassembly import Exported, WebFiles, WebModule
from p3dof.machine.parameters import LINKS, PAPER, SLIDES

_STATUSES = (
    "OK",
    "NOT_FINITE",
    "OUT_OF_REACH",
    "SINGULAR",
    "BAD_PARAMETERS",
    "NULL_POINTER",
    "BEYOND_LIMITS",
)
_BODY = 10
_MAP = """
    /**
     * The workspace at one tilt, the platform at rest: `forces` (A, B, C) and `margins` for each y, and
     * for each y a `status` of each z. `wrench` may be missing.
     */
    map({ theta, y, z, wrench }) {
        const loads = wrench ?? [], doubles = 5 * y.length + z.length + loads.length;
        let place = this.#room(doubles + Math.ceil((y.length * z.length) / 8));
        const buffer = this.#exports.memory.buffer, views = [], places = [];
        const given = [[y.length, y], [z.length, z], [loads.length, loads]];
        for (const [size, values] of [...given, [3 * y.length], [y.length]]) {
            const view = new Float64Array(buffer, place, size);
            if (values) view.set(values);
            else view.fill(NaN);
            views.push(view);
            places.push(place);
            place += view.byteLength;
        }
        const status = new Uint8Array(buffer, place, y.length * z.length);
        if (!wrench) places[2] = 0;
        this.#exports.map(theta, y.length, places[0], z.length, ...places.slice(1), place);
        return { forces: views[3].slice(), margins: views[4].slice(), status: status.slice() };
    }
"""
_METHODS = """
    /** The machine's numbers by \\u0060places\\u0060, in memory: change them, and prepare. */
    get parameters() {
        return new Float64Array(this.#exports.memory.buffer, this.#exports.parameters(), @count);
    }

    /** Makes the machine of the present parameters ready; returns a status. */
    prepare() {
        return this.#exports.prepare();
    }

    /** Fixes a payload to the platform: mass, mass centre (3), inertia (6); returns a status. */
    carry(payload) {
        return this.#exports.carry(this.#put(payload));
    }
"""


def controller_module(
    bake: bool = False,
    prefix: str = PREFIX,
    note: str = f"{MARK}`: do not edit.",
    only: Collection[str] | None = None,
    optimisation: str = "-O2",
) -> WebModule:
    """Return what the WebAssembly of a controller's C offers."""
    first = "" if bake else "&model"
    pass_model = "" if bake else "&model, "
    area = fill("wasm_map.in", prefix=prefix, pass_model=pass_model)
    functions = [Exported(row, first) for row in prototypes() if only is None or row.name in only]
    statuses = dict(enumerate(_STATUSES))
    if bake:
        return WebModule(prefix, note, functions, statuses, area, _MAP, optimisation=optimisation)
    places, count = _places()
    return WebModule(
        prefix,
        note,
        functions,
        statuses,
        state=fill("wasm_machine.in", prefix=prefix, PREFIX=prefix.upper()) + area,
        methods=_MAP + _METHODS.replace("@count", str(count)).replace("\\u0060", "`"),
        constructed="\n        exports.initialise();",
        places=places,
        optimisation=optimisation,
    )


def _places() -> tuple[dict[str, object], int]:
    """Return where the parameters of `p3dof_parameters` are, in doubles, and how many there are."""
    found: dict[str, object] = {name: place for place, name in enumerate(("r", "R", "L", "b", "gravity"))}
    place = 7
    found["bodies"] = {link: place + _BODY * i for i, link in enumerate(LINKS)}
    place += _BODY * len(LINKS)
    for kind in ("viscous", "coulomb"):
        found[kind] = {joint: place + i for i, joint in enumerate(JOINTS)}
        place += len(JOINTS)
    for name, size in (("smoothing", 1), ("travel", 2), ("speed", 1), ("force", 1), ("tilt", 2)):
        found[name] = place
        place += size
    for kind in ACTUATORS:
        found[kind] = {slide: place + i for i, slide in enumerate(SLIDES)}
        place += len(SLIDES)
    return found, place


DIRECTORY = Path(__file__).parents[1] / "viewer" / "document"
FUNCTIONS = (
    "inverse_dynamics",
    "inverse_kinematics",
    "jacobian",
    "mass_matrix",
    "forward_dynamics",
    "forward_kinematics",
    "joints",
)
"""What the page calls on samples, besides the map."""
_COMMAND = "p3dof codegen --page"


def page_wasm() -> tuple[WebFiles, dict[str, str]]:
    """Return the WebAssembly of the page, and the C that it is built from."""
    note = origin_of(PAPER, command=_COMMAND)
    module = controller_module(note=note, only=FUNCTIONS, optimisation="-Oz")
    texts = controller_files(PAPER, command=_COMMAND)
    return WebFiles(module), {name: texts[name] for name in (f"{PREFIX}.h", f"{PREFIX}.c")}
