"""What is installed says what it is: wheels by their names and licences, the program by its version."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest
import wheels
from documents import ROOT

import p3dof
from p3dof.cli import main
from p3dof.closed_form.compiled import kernels

PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")  # Python 3.10 reads no TOML
(LICENCE,) = re.findall(r'^license = "(.*)"$', PROJECT, re.MULTILINE)
LICENCE_FILES = json.loads(re.findall(r"^license-files = (.*)$", PROJECT, re.MULTILINE)[0])
COMPILER = (sysconfig.get_config_var("CC") or "cc").split()[0]
SMALL = """
#include <Python.h>
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_compiled", 0, -1, 0};
PyMODINIT_FUNC PyInit__compiled(void) { return PyModule_Create(&module); }
"""


@pytest.fixture
def source(tmp_path):
    """The source tree with a small extension, which is compiled in no time."""
    pytest.importorskip("setuptools.command.bdist_wheel", reason="setuptools is older than 70.1")
    tree = tmp_path / "source"
    left_out = shutil.ignore_patterns("*.so", "__pycache__", "generated")
    shutil.copytree(ROOT / "p3dof", tree / "p3dof", ignore=left_out)
    for name in ("urdf", "docs/_static/gallery"):
        shutil.copytree(ROOT / name, tree / name)
    for name in ("setup.py", "pyproject.toml", "README.md", "LICENSE", "THIRD-PARTY.md", "MANIFEST.in"):
        shutil.copy(ROOT / name, tree)
    for code in (tree / "p3dof" / "_native").glob("*.c"):
        code.write_text(SMALL if code.stem == "_compiled" else "extern int nothing;\n")
    return tree


def wheel(tree, **variables):
    """Build a wheel as pip does, without a network; return its name and what is in it."""
    build = "from setuptools import build_meta; print(build_meta.build_wheel('wheels'))"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-c", build]
    options = {"cwd": tree, "env": environment | variables, "capture_output": True, "text": True}
    ran = subprocess.run(command, check=False, **options)
    assert ran.returncode == 0, ran.stderr
    name = ran.stdout.splitlines()[-1]
    with zipfile.ZipFile(tree / "wheels" / name) as file:
        metadata = next(member for member in file.namelist() if member.endswith(".dist-info/WHEEL"))
        return name, file.namelist(), file.read(metadata).decode()


def has_extension(members):
    return any(
        member.startswith("p3dof/_native/_compiled.") and member.endswith((".so", ".pyd"))
        for member in members
    )


def test_a_wheel_without_the_extension_does_not_pass_for_one_with_it(source):
    if shutil.which(COMPILER) is None or not Path(sysconfig.get_path("include"), "Python.h").exists():
        pytest.skip("no compiler, or no headers of Python")
    stable = sys.version_info >= (3, 12) and not sysconfig.get_config_var("Py_GIL_DISABLED")
    own = "cp312-abi3" if stable else "cp{0}{1}-cp{0}{1}".format(*sys.version_info)
    name, members, metadata = wheel(source)
    assert has_extension(members)
    assert f"-{own}-" in name
    assert "Root-Is-Purelib: false" in metadata
    code = source / "p3dof" / "_native" / "_compiled.c"
    code.write_text(SMALL + "/* changed, so that it has to be compiled again */\n")
    os.utime(code, (2e9, 2e9))
    name, members, metadata = wheel(source, CC="no-such-compiler")  # and what was built before is not taken
    assert not has_extension(members)
    assert name == f"p3dof-{p3dof.__version__}-py3-none-any.whl"
    assert "Root-Is-Purelib: true" in metadata
    assert "p3dof/__init__.py" in members


def test_a_wheel_without_the_extension_on_purpose(source):
    name, members, metadata = wheel(source, P3DOF_NO_EXTENSION="1")
    assert not has_extension(members)
    assert name.endswith("-py3-none-any.whl")
    assert "Root-Is-Purelib: true" in metadata
    models = {f"urdf/{path.name}" for path in (ROOT / "urdf").iterdir()}
    robots = [file for file in (ROOT / "docs/_static/gallery").iterdir() if file.suffix != ".png"]
    models |= {f"gallery/{path.name}" for path in robots}
    packed = [member.partition("p3dof/models/")[2] for member in members if "p3dof/models/" in member]
    assert sorted(packed) == sorted(models)
    shutil.unpack_archive(source / "wheels" / name, source / "installed", "zip")
    held = "from p3dof import model_files; print(model_files.REPOSITORY_PATH, *model_files.NAMES)"
    here = {**os.environ, "PYTHONPATH": str(source / "installed")}
    told = subprocess.check_output([sys.executable, "-c", held], text=True, env=here, cwd=source / "wheels")
    assert told.split() == [str(source / "installed/p3dof/models"), *p3dof.model_files.NAMES]
    (information,) = {member.partition("/")[0] for member in members if ".dist-info/" in member}
    metadata = (source / "installed" / information / "METADATA").read_text(encoding="utf-8")
    assert re.findall("^License-Expression: (.*)", metadata, re.MULTILINE) == [LICENCE]
    assert re.findall("^License-File: (.*)", metadata, re.MULTILINE) == LICENCE_FILES
    for file in LICENCE_FILES:
        packed = source / "installed" / information / "licenses" / file
        assert packed.read_bytes() == (ROOT / file).read_bytes()


def test_the_works_of_others_are_those_of_the_pages_under_their_licences():
    """And which works each page holds, `make page` and its check compare with what the bundler took."""
    packages = json.loads((ROOT / "page/package-lock.json").read_text(encoding="utf-8"))["packages"]
    text = (ROOT / "THIRD-PARTY.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\S+) \| ([\d.]+) \| (\S+) \| `(\S+)` \|$", text, re.MULTILINE)
    notices = dict(re.findall(r"^## (\S+)\n\n```text\n(.*?)\n```$", text, re.MULTILINE | re.DOTALL))
    assert list(notices) == [work for work, *_ in rows]
    assert {page for *_, page in rows} == {
        f"p3dof/viewer/document/{name}.html" for name in ("page", "studio")
    }
    for work, version, licence, page in rows:
        known = packages[f"node_modules/{work}"]
        assert (known["version"], known["license"]) == (version, licence)
        assert " ".join(notices[work].split()) in " ".join((ROOT / page).read_text(encoding="utf-8").split())
    assert set(LICENCE.split(" AND ")) == {"BSD-2-Clause", *(licence for _, _, licence, _ in rows)}


@pytest.mark.skipif(platform.machine() != "x86_64" or sys.platform != "linux", reason="levels of x86")
def test_which_levels_of_the_processor_an_extension_is_compiled_for(source):
    if shutil.which(COMPILER) is None or not Path(sysconfig.get_path("include"), "Python.h").exists():
        pytest.skip("no compiler, or no headers of Python")
    told = Path("/proc/cpuinfo").read_text(encoding="ascii").split()
    best = [level for level, flag in {"avx2": "avx2", "avx512": "avx512dq"}.items() if flag in told][-1:]
    for level in ("avx2", "avx512"):
        text = f'#ifndef P3DOF_NO_{level.upper()}\nconst char p3dof_{level}[] = "level {level}";\n#endif\n'
        (source / "p3dof" / "_native" / f"level_{level}.c").write_text(text)
    found = {}
    for asked in ("", "native"):
        name, members, _ = wheel(source, P3DOF_BUILD_LEVELS=asked)
        with zipfile.ZipFile(source / "wheels" / name) as file:
            data = file.read(next(member for member in members if has_extension([member])))
        found[asked] = [level for level in ("avx2", "avx512") if f"level {level}".encode() in data]
        shutil.rmtree(source / "build")
    assert found == {"": ["avx2", "avx512"], "native": best}


def test_which_wheel_is_for_which_python():
    """As pip takes them; `make wheels-check` tries each where it fits."""
    names = {
        "p3dof-0.1.0-cp310-cp310-linux_x86_64.whl": [(3, 10)],
        "p3dof-0.1.0-cp311-cp311-manylinux_2_17_x86_64.whl": [(3, 11)],
        "p3dof-0.1.0-cp312-abi3-linux_x86_64.whl": [(3, 12), (3, 13), (3, 14)],
        "p3dof-0.1.0-py3-none-any.whl": [(3, 10), (3, 11), (3, 12), (3, 13), (3, 14)],
    }
    for name, pythons in names.items():
        assert [of for of in ((3, k) for k in range(10, 15)) if wheels.fits(Path(name), of)] == pythons
    assert f"0x{wheels.STABLE[0]:02X}{wheels.STABLE[1]:02X}0000" == "0x030C0000"
    assert "LIMITED_API = 0x030C0000" in (ROOT / "setup.py").read_text(encoding="utf-8")


def version(capsys):
    code = main(["--version"])
    captured = capsys.readouterr()
    return code, captured.out.strip(), captured.err


def test_the_version_says_which_kernels_run(capsys, monkeypatch):
    begin = f"p3dof {p3dof.__version__} (kernels: "
    robot = p3dof.load()
    monkeypatch.delenv("P3DOF_LEVEL", raising=False)
    monkeypatch.setenv("P3DOF_THREADS", "3")
    shown = version(capsys)[1]
    assert shown.startswith(begin + robot.kernels.level)
    for level in kernels.levels()[1:]:
        monkeypatch.setenv("P3DOF_LEVEL", level)
        assert version(capsys)[1] == f"{begin}{level}, 3 threads)"
    monkeypatch.setenv("P3DOF_LEVEL", "avx9000")
    code, out, error = version(capsys)
    assert (code, out) == (2, "")
    assert "P3DOF_LEVEL: expected one of numpy" in error
    monkeypatch.setenv("P3DOF_LEVEL", "numpy")
    if len(kernels.levels()) > 1:
        assert version(capsys)[1] == f"{begin}numpy: P3DOF_LEVEL asks for it)"
    monkeypatch.setattr(kernels, "_extension", lambda: None)
    monkeypatch.setattr(kernels, "find_spec", lambda _: None)
    unbuilt = "no extension was built at installation (no compiler, or P3DOF_NO_EXTENSION)"
    assert version(capsys)[1] == f"{begin}numpy: {unbuilt})"
    for value, words in (("1", "no extension, P3DOF_NO_EXTENSION switches it off"), ("0", unbuilt)):
        monkeypatch.setenv("P3DOF_NO_EXTENSION", value)
        assert version(capsys)[1] == f"{begin}numpy: {words})"
    monkeypatch.setattr(kernels, "find_spec", lambda name: ModuleSpec(name, None))  # of another Python
    assert version(capsys)[1] == f"{begin}numpy: the extension does not load, install it again)"
