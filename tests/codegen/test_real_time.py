"""What generated C keeps to for a loop in real time: no memory, no recursion, bounded loops, a known stack.

The rules of MISRA C:2012 that it deviates from are those of a table of the page, which cppcheck holds it to.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache

import pytest
from compilers import COMPILED
from documents import ROOT
from gallery import gallery

from p3dof.codegen.controller import controller_files
from p3dof.codegen.loops import START_STEPS, STEPS, loop_files
from p3dof.loops.transmission import STEPS_OF_PIECE, TRIES
from p3dof.machine.parameters import PAPER

PAGE = ROOT / "docs/how-to/real-time.md"
ANKLE = {"coordinates": ["ankle_pitch", "ankle_roll"]}
MADE = {
    "machine": lambda: controller_files(PAPER, False, "machine"),
    "baked": lambda: controller_files(PAPER, True, "baked"),
    "floats": lambda: controller_files(PAPER, True, "floats", precision="float"),
    "robot": lambda: loop_files(gallery("five_bar"), "robot").files,
    "payload": lambda: (
        loop_files(gallery("five_bar"), "payload", inertias=["right_elbow"], estimator=True).files
    ),
    "ankle": lambda: loop_files(gallery("leg"), "ankle", **ANKLE).files,
    "single": lambda: loop_files(gallery("leg"), "single", precision="float", **ANKLE).files,
}
every = pytest.mark.parametrize("name", MADE)


@cache
def text_of(name):
    return MADE[name]()


@pytest.fixture
def folder(name, tmp_path):
    for file, text in text_of(name).items():
        (tmp_path / file).write_text(text, encoding="utf-8")
    return tmp_path


def code_of(name):
    """The library's C without comments and texts."""
    source = re.sub(r"/\*.*?\*/|//[^\n]*", " ", text_of(name)[f"{name}.c"], flags=re.DOTALL)
    return re.sub(r'"[^"\n]*"', '""', source)


@every
def test_no_memory_is_taken_and_no_way_jumped(name):
    found = set(re.findall(r"\b[a-z_]\w*\b(?= ?\()", code_of(name)))
    assert not found & {
        "malloc",
        "calloc",
        "realloc",
        "free",
        "alloca",
        "printf",
        "exit",
        "setjmp",
        "longjmp",
    }
    assert not set(re.findall(r"\b[a-z]+\b", code_of(name))) & {
        "goto",
        "while",
        "do",
        "asm",
        "union",
        "volatile",
    }
    assert re.findall(r"#include [<\"](\S+)[>\"]", code_of(name).replace('""', '"x.h"'))
    includes = set(re.findall(r"#include <(\S+)>", text_of(name)[f"{name}.c"]))
    assert includes <= {"float.h", "math.h", "stddef.h", "stdint.h", "string.h"}


def functions(code):
    """The functions of a file: parameters, body, by name."""
    found = {}
    for match in re.finditer(
        r"^(?:static )?(?:inline )?[\w* ]+?\b(\w+)\(([^;{}]*)\)\n\{\n(.*?)^\}", code, re.M | re.S
    ):
        parameters = [part.split()[-1].strip("*").partition("[")[0] for part in match[2].split(",")]
        found[match[1]] = parameters, match[3]
    return found


def constant(bound, owner, known):
    """Whether a bound is a number whatever the program is given: of numbers, sizes, or what callers pass."""
    words = set(re.findall(r"[A-Za-z_]\w*", re.sub(r"\b\d+[A-Za-z]+\b|sizeof [*\w]+", "0", bound)))
    words -= {"size_t", "int", "sizeof"}
    words = {word for word in words if not word.isupper()}
    parameters = known[owner][0]
    for word in words:
        if word not in parameters:
            return False
        place, calls = parameters.index(word), 0
        for caller, (_, body) in known.items():
            for call in re.findall(rf"\b{owner}\(((?:[^()]|\([^()]*\))*)\)", body):
                calls += 1
                given = re.split(r",(?![^(\[]*[)\]])", call)[place]
                if not constant(given.strip(), caller, known):
                    return False
        if not calls:
            return False
    return True


@every
def test_every_loop_has_a_bound_that_no_number_changes(name):
    known = functions(code_of(name))
    assert len(known) > 8
    seen = 0
    for owner, (_, body) in known.items():
        for start, condition, step in re.findall(r"\bfor \(([^;]*);([^;]*);([^{]*)\) \{", body):
            variable = start.split("=")[0].strip()
            seen += 1
            assert step.strip() in (f"++{variable}", f"--{variable}")
            first, _, rest = condition.partition("&&")
            assert "done < 1.0" in rest or not rest
            down = re.fullmatch(rf" ?\(?{variable} >= 0\)?", first.rstrip())
            up = re.fullmatch(rf" ?\(?{variable} < (.*?)\)?", first.rstrip())
            if owner == f"{name}_map" and up[1] in ("y_count", "z_count"):
                continue  # as many poses as its caller asks for
            assert down or constant(up[1] + ")" * (up[1].count("(") - up[1].count(")")), owner, known), (
                condition
            )
            inner = body.split(f"for ({start};{condition};{step})")[1]
            assert not re.search(rf"^\s*{variable} [-+*/]?= ", inner.split("for (")[0], re.M)
    assert seen == len(re.findall(r"\bfor \(", code_of(name)))
    assert seen >= 3


def test_a_loop_without_a_bound_would_be_noticed():
    code = "static void once(size_t n)\n{\n    f(n);\n}\n\nvoid f(size_t n)\n{\n    x;\n}\n\n"
    code += "void g(void)\n{\n    f(3U);\n}\n"
    known = functions(code)
    assert constant("4U", "g", known)
    assert not constant("n", "f", known)  # once passes on what nobody gives
    assert not constant("*n", "f", known)


def graph_of(folder, name, *flags):
    """Stack [bytes] of each function, and whom it calls, as gcc has them."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc not installed")
    command = [
        "gcc",
        "-std=c99",
        "-Wvla",
        "-Walloca",
        "-Werror",
        "-fcallgraph-info=su",
        *flags,
        "-c",
        f"{name}.c",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    text = (folder / f"{name}.ci").read_text(encoding="utf-8")
    nodes = re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \((\w+)\)', text)
    edges = re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text)
    assert {kind for *_, kind in nodes} == {"static"}
    calls = {}
    for source, target in edges:
        calls.setdefault(source, set()).add(target)
    return {node: int(size) for node, size, _ in nodes}, calls


def deepest(node, sizes, calls, above=()):
    """Stack of a call with all that it calls; a function that calls itself is an error."""
    assert node not in above, f"{node} calls itself"
    return sizes.get(node, 0) + max(
        (deepest(each, sizes, calls, (*above, node)) for each in calls.get(node, ())), default=0
    )


@COMPILED
@every
def test_the_stack_is_known_and_nothing_calls_itself(folder, name):
    sizes, calls = graph_of(folder, name, "-O2")
    public = {node: deepest(node, sizes, calls) for node in sizes if f"{name}_" in node}
    assert len(public) >= 6
    outside = {target for each in calls.values() for target in each} - set(sizes)
    libm = {"atan2", "cos", "floor", "hypot", "sin", "sincos", "sqrt", "tanh"}
    assert outside <= {"memcpy", "memset", *libm, *(f"{one}f" for one in libm)}  # no call by a pointer
    most = max(public.values())
    table = {
        row[0]: int(row[1].replace(",", "")) for row in re.findall(r"^\| `(\w+)` \| ([\d,]+) ", page(), re.M)
    }
    assert table[name] / 2 < most < 2 * table[name]  # another compiler has others


def page():
    return PAGE.read_text(encoding="utf-8")


def test_the_page_has_the_iterations_of_the_code():
    most = TRIES * STEPS_OF_PIECE + 1
    assert f"at most {TRIES} pieces of {STEPS_OF_PIECE} steps: {most} linearisations" in page()
    assert f"| `follow` | {STEPS} steps of Newton's method; `start` {START_STEPS} |" in page()
    for name, counts in (("ankle", (TRIES, STEPS_OF_PIECE)), ("robot", (STEPS, START_STEPS))):
        bounds = re.findall(r"for \((?:tries|step) = 0; \(?(?:tries|step) < (\d+)", code_of(name))
        assert {int(one) for one in bounds} == {*counts}


@COMPILED
@every
def test_nothing_is_global_but_constants(folder, name):
    if shutil.which("gcc") is None or shutil.which("nm") is None:
        pytest.skip("gcc or nm not installed")
    command = ["gcc", "-std=c99", "-O1", "-c", f"{name}.c"]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    done = subprocess.run(["nm", f"{name}.o"], cwd=folder, capture_output=True, text=True, check=True)
    kinds = set(re.findall(r"^\w* +(\w) ", done.stdout, re.M))
    assert kinds <= {"T", "t", "R", "r", "U"}  # no D, B, C: nothing that a call could leave behind


@pytest.mark.parametrize("name", ["floats", "single"])
def test_single_precision_names_no_double(name):
    code = code_of(name)
    assert not re.search(r"\bdouble\b", code)
    assert not re.search(r"(?<![\w.])\d+\.\d*(?:e[-+]?\d+)?(?![\w.])", code)  # a number without F is a double


def judged(folder, file):
    """The rules of MISRA C:2012 that cppcheck finds a file to deviate from."""
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck not installed")
    command = ["cppcheck", "--std=c99", "--addon=misra", "--quiet", "--template={id}", file]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert "error" not in done.stdout.lower()
    return {
        line.removeprefix("misra-c2012-")
        for line in done.stderr.splitlines()
        if line.startswith("misra-c2012-")
    }


@cache
def same_version():
    """Whether cppcheck is that of the page; others see more or less."""
    return (
        "2.10" in subprocess.run(["cppcheck", "--version"], capture_output=True, text=True, check=True).stdout
    )


def deviations():
    """Those of the page."""
    rows = re.findall(r"^\| (\d+\.\d+(?:, \d+\.\d+)*) \|", page(), re.M)
    return {rule for row in rows for rule in row.split(", ")}


def kept():
    return set(re.findall(r"\d+\.\d+", re.search(r"Among those that it keeps: (.*)\.", page())[1]))


@pytest.fixture(scope="module")
def rules(tmp_path_factory):
    """The rules that the C of a name deviates from, once each: cppcheck takes long."""
    base = tmp_path_factory.mktemp("rules")

    @cache
    def of(name):
        for file, text in text_of(name).items():
            (base / file).write_text(text, encoding="utf-8")
        return judged(base, f"{name}.c")

    return of


@pytest.mark.parametrize(
    "name", ["robot", *(pytest.param(x, marks=pytest.mark.slow) for x in MADE if x != "robot")]
)
def test_the_rules_that_it_deviates_from_are_those_of_the_page(rules, name):
    assert not rules(name) & kept()
    assert "15.5" in rules(name)  # it looked
    if same_version():
        assert rules(name) <= deviations()


@pytest.mark.slow
def test_the_page_names_no_rule_in_vain(rules):
    found = set().union(*map(rules, MADE))
    assert not same_version() or found == deviations()


def test_rules_that_it_keeps_would_be_noticed(tmp_path):
    text = "int f(int n)\n{\n    int *p = malloc(4U);\n    if (p == NULL) {\n        goto out;\n    }\n"
    text += "    free(p);\nout:\n    return (n > 0) ? f(n - 1) : 0;\n}\n"
    (tmp_path / "bad.c").write_text(f"#include <stdlib.h>\nint f(int n);\n{text}", encoding="ascii")
    found = judged(tmp_path, "bad.c")
    assert {"15.1", "17.2", "21.3"} <= found & kept()
