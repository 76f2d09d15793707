"""Files of others are read safely, and ours are written whatever the machine and wherever to."""

import importlib.util
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from reference import FILES, URDF

import p3dof
from p3dof._base.errors import ModelError, ModelWarning, MotionError, P3dofError, ParameterError
from p3dof.loops import ClosedLoopModel, Sidecar
from p3dof.machine import description
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import PAPER, Bodies, Body, Geometry, read_parameters, write_parameters
from p3dof.machine.parameters.machine import of_solids

READERS = {
    "urdf": ClosedLoopModel.from_urdf,
    "sidecar": Sidecar.from_yaml,
    "parameters": read_parameters,
    "motion": Motion.from_csv,
}
SIDECAR = FILES / "p3dof.yaml"
PROMPT = 20.0
"""Seconds of a processor within which a bad file must be refused."""


def refuse(read, path, kind=P3dofError):
    """Read a bad file; return its error, which must be one line, name the file and come soon."""
    start = time.process_time()
    with pytest.raises(kind) as caught:
        read(path)
    assert time.process_time() - start < PROMPT
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    assert len(message) < 1000
    return message


# --- entities ----------------------------------------------------------------------------------------------

LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
ENTITIES = {
    "laughs": f'<!DOCTYPE robot [<!ENTITY l0 "lol">{LAUGHS}]><robot name="&l11;"><link name="a"/></robot>',
    "blowup": f'<!DOCTYPE robot [<!ENTITY a "{"a" * 100_000}">]><robot name="r">{"&a;" * 10_000}</robot>',
    "file": '<!DOCTYPE robot [<!ENTITY e SYSTEM "file:///etc/passwd">]>'
    '<robot name="r"><link name="&e;"/>&e;</robot>',
    "network": '<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/r.dtd"><robot name="r"><link name="a"/></robot>',
    "parameter": '<!DOCTYPE robot [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]>'
    '<robot name="r"><link name="a"/></robot>',
    "undeclared": '<robot name="r"><link name="&e;"/></robot>',
}


@pytest.mark.parametrize("text", ENTITIES.values(), ids=ENTITIES)
def test_entities_of_a_urdf_are_refused_unexpanded(tmp_path, text):
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    message = refuse(ClosedLoopModel.from_urdf, path, ModelError)
    assert "document type declaration is not allowed" in message or "undefined entity" in message
    assert "root:" not in message
    with pytest.raises(ModelError):
        ClosedLoopModel.from_urdf(text)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "utf-7"])
def test_entities_do_not_pass_in_another_encoding(tmp_path, encoding):
    path = tmp_path / "robot.urdf"
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{ENTITIES["file"]}'.encode(encoding))
    assert "root:" not in refuse(ClosedLoopModel.from_urdf, path, ModelError)


def test_files_that_a_urdf_names_are_not_opened():
    text = URDF.read_text(encoding="utf-8").replace(
        '<sphere radius="0.015" />', '<mesh filename="file:///etc/passwd" />'
    )
    include = '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="/etc/passwd" /></robot>'
    with pytest.warns(ModelWarning, match="not understood, and left out: <xi:include>"):
        assert ClosedLoopModel.from_urdf(text.replace("</robot>", include), SIDECAR).model.nv == 10


# --- YAML --------------------------------------------------------------------------------------------------

BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
YAML = {
    "bomb": BOMB,
    "merge bomb": "a0: &a0 {k: 1}\n"
    + "".join(f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 12)),
    "itself": "closed_loop: &a [*a]\ntype: []\nname_mot: []\n",
    "apply": "closed_loop: !!python/object/apply:os.mkdir ['{made}']\n",
    "new": "!!python/object/new:os.mkdir ['{made}']\n",
    "module": "a: !!python/module:antigravity\n",
    "deep": "[" * 100_000,
    "deep mapping": "".join(f"{' ' * i}a:\n" for i in range(3000)),
    "digits": f"closed_loop: {'9' * 200_000}\n",
}
HUGE = {
    "hexadecimal": f"closed_loop: 0x{'f' * 100_000}\n",
    "sexagesimal": f"closed_loop: 1{':59' * 10_000}\n",
}


@pytest.mark.parametrize("name", ["sidecar", "parameters"])
@pytest.mark.parametrize("text", YAML.values(), ids=YAML)
def test_yaml_neither_runs_nor_swells(tmp_path, name, text):
    made = tmp_path / "made"
    path = tmp_path / "file.yaml"
    path.write_text(text.replace("{made}", str(made)))
    refuse(READERS[name], path, {"sidecar": ModelError, "parameters": ParameterError}[name])
    assert not made.exists()


@pytest.mark.parametrize("text", HUGE.values(), ids=HUGE)
def test_a_huge_number_among_the_parameters_is_one_error(tmp_path, text):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    refuse(read_parameters, path, ParameterError)


@pytest.mark.parametrize("text", HUGE.values(), ids=HUGE)
def test_a_huge_number_in_a_sidecar_is_one_error(tmp_path, text):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    refuse(Sidecar.from_yaml, path, ModelError)


# --- too large, or cut short -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", READERS)
def test_a_hundred_megabytes_are_refused_soon(tmp_path, name):
    path = tmp_path / "large"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)  # takes no space on disk
    refuse(READERS[name], path)


@pytest.mark.parametrize(
    ("name", "line"), [("urdf", "<a>"), ("sidecar", "- [a, b]"), ("parameters", "a: 1"), ("motion", "0" * 80)]
)
def test_a_hundred_megabytes_of_text_are_refused_soon(tmp_path, name, line):
    path = tmp_path / "large"
    block = (line + "\n") * (1_000_000 // (len(line) + 1))
    with path.open("w", encoding="utf-8") as stream:
        for _ in range(101):
            stream.write(block)
    refuse(READERS[name], path)


@pytest.mark.parametrize("name", READERS)
def test_devices_and_nothing_are_refused(tmp_path, name):
    (tmp_path / "empty").touch()
    for path in (tmp_path / "empty", tmp_path / "none", tmp_path, "/dev/zero"):
        refuse(READERS[name], path)


def same_model(one, two):
    return (
        list(one.names) == list(two.names)
        and all(np.array_equal(a.toDynamicParameters(), b.toDynamicParameters())
                for a, b in zip(one.inertias, two.inertias, strict=True))
        and one.jointPlacements.tolist() == two.jointPlacements.tolist()
        and np.array_equal(one.upperPositionLimit, two.upperPositionLimit)
    )  # fmt: skip


def test_a_urdf_cut_anywhere_is_one_error_and_never_another_robot(tmp_path):
    content = URDF.read_bytes()
    end = len(content.rstrip())  # the line end after </robot> may be missing
    path = tmp_path / "cut.urdf"
    for size in [*range(0, end, 29), *range(end - 60, end)]:
        path.write_bytes(content[:size])
        refuse(ClosedLoopModel.from_urdf, path, ModelError)
    path.write_bytes(content[:end])
    assert same_model(ClosedLoopModel.from_urdf(path, ()).model, ClosedLoopModel.from_urdf(URDF, ()).model)


def test_a_sidecar_cut_anywhere_is_one_error(tmp_path):
    content = SIDECAR.read_bytes()
    end = len(content.rstrip())
    path = tmp_path / "cut.yaml"
    for size in range(end):
        path.write_bytes(content[:size])
        refuse(Sidecar.from_yaml, path, ModelError)
    path.write_bytes(content[:end])
    assert Sidecar.from_yaml(path) == Sidecar.from_yaml(SIDECAR)


def test_parameters_cut_anywhere_are_one_error(tmp_path):
    write_parameters(PAPER, tmp_path / "whole.yaml")
    content = (tmp_path / "whole.yaml").read_bytes()
    end = len(content.rstrip())
    path = tmp_path / "cut.yaml"
    for size in [*range(0, end, 23), *range(end - 20, end)]:
        path.write_bytes(content[:size])
        refuse(read_parameters, path)


def test_a_motion_cut_anywhere_is_one_error_or_its_beginning(tmp_path):
    """CSV has no end mark: whole lines that are missing cannot be noticed, nor digits of the last number."""
    whole = p3dof.paper_motion(12)
    whole.to_csv(tmp_path / "whole.csv")
    content = (tmp_path / "whole.csv").read_bytes()
    path = tmp_path / "cut.csv"
    seen = 0
    for size in range(0, len(content), 3):
        path.write_bytes(content[:size])
        try:
            motion = Motion.from_csv(path)
        except MotionError as error:
            assert str(path) in str(error)  # noqa: PT017 - either is right
            continue
        complete = len(motion) - 1
        assert np.array_equal(motion.pose[:complete], whole.pose[:complete])
        assert np.array_equal(motion.pose[complete], whole.pose[complete])
        seen += 1
    assert seen > 3


def read_elsewhere(text_of, seconds=20):
    """Read a URDF, made by an expression, in another process; return its exit code and what it says."""
    code = (
        "from p3dof.loops import ClosedLoopModel\nfrom p3dof._base.errors import ModelError\n"
        f"text = {text_of}\n"
        "try: ClosedLoopModel.from_urdf(text)\n"
        "except ModelError as error: print(error)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=seconds
    )
    return result.returncode, result.stdout


DEEP = """'<robot name="r"><link name="a"/>' + '<q>' * {0} + '</q>' * {0} + '</robot>'"""
LONG = """'<robot name="r"><link name="l0"/>' + ''.join(
    f'<link name="l{{i + 1}}"/><joint name="j{{i}}" type="fixed">'
    f'<parent link="l{{i}}"/><child link="l{{i + 1}}"/></joint>'
    for i in range({0})
) + '</robot>'"""


def test_a_nested_urdf_is_one_error():
    code, said = read_elsewhere(DEEP.format(10_000))
    assert code == 0
    assert "nested" in said


def test_a_deeply_nested_urdf_is_refused_soon():
    code, said = read_elsewhere(DEEP.format(300_000), seconds=6)
    assert code == 0
    assert said


def test_a_long_chain_of_links_is_read():
    assert read_elsewhere(LONG.format(500)) == (0, "")


def test_a_chain_too_long_for_pinocchio_is_one_error():
    code, said = read_elsewhere(LONG.format(6_000))
    assert code == 0
    assert "expected at most 1000 links" in said


# --- written anywhere, for any machine ---------------------------------------------------------------------


@pytest.mark.parametrize("folder", ["with space", "Größe θ – 模型", 'a\'b "c" & <d>', "-dash", "🤖/deep er"])
def test_every_format_is_written_into_any_folder(tmp_path, folder):
    formats = [name for name in description.FORMATS if name != "usd" or importlib.util.find_spec("pxr")]
    paths = description.write(PAPER, tmp_path / folder, formats)
    assert {path.parent for path in paths} == {tmp_path / folder}
    assert description.check(PAPER, tmp_path / folder, formats) == []
    urdf, sidecar = (tmp_path / folder / name for name in ("p3dof.urdf", "p3dof.yaml"))
    assert ClosedLoopModel.from_urdf(urdf, sidecar).mobility(np.zeros(10)) == 3
    assert pin.buildModelFromUrdf(str(urdf)).nv == 10


def scaled(factor):
    geometry = Geometry(**{name: factor * value for name, value in vars(PAPER.geometry).items()})
    bodies = {
        name: Body(body.mass * factor**3, body.com * factor, body.inertia * factor**5)
        for name, body in PAPER.bodies.items()
    }
    return replace(PAPER, geometry=geometry, bodies=Bodies(**bodies))


def shaped(**lengths):
    return replace(PAPER, geometry=replace(PAPER.geometry, **lengths))


WIDTH = PAPER.geometry.R - PAPER.geometry.r
EXTREMES = {
    **{f"scale {factor:g}": scaled(factor) for factor in (1e-3, 1e-2, 1e2, 1e3)},
    **{f"solids {factor:g}": of_solids(scaled(factor).geometry) for factor in (1e-3, 1e3)},
    **{f"b = {b:g}": shaped(b=b) for b in (0.006, 1.0, 100.0)},
    "solids, b = 1 mm": of_solids(shaped(b=1e-3).geometry),
    "no gravity": replace(PAPER, gravity=np.zeros(3)),
    "gravity aside": replace(PAPER, gravity=[1e3, -1e3, 0]),
    "r near R": shaped(r=PAPER.geometry.R * (1 - 2e-6)),
    "tiny r": shaped(r=1e-6),
    "L hardly reaches": shaped(L=WIDTH * (1 + 1e-9)),
    "long L": shaped(L=1.0),
}


def assert_generates(parameters, exact):
    texts = description.texts(parameters, exact=exact)
    model = pin.buildModelFromXML(texts["p3dof.urdf"])
    assert list(model.names)[1:] == [joint.name for joint in description.describe(parameters).moving]
    masses = [inertia.mass for inertia in model.inertias][1:]
    assert sum(masses) == pytest.approx(parameters.bodies.mass, rel=1e-13)
    assert exact or min(masses) > 0
    loop = ClosedLoopModel.from_urdf(texts["p3dof.urdf"], Sidecar.parse(texts["p3dof.yaml"], "sidecar"))
    size = max(vars(parameters.geometry).values())
    assert np.abs(loop.closure_error(np.zeros(10))).max() < 1e-14 * size
    assert loop.mobility(np.zeros(10)) == 3
    assert description.texts(parameters, exact=exact) == texts


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("parameters", EXTREMES.values(), ids=EXTREMES)
def test_extreme_machines_are_written_and_load(parameters, exact):
    assert_generates(parameters, exact)


@pytest.mark.parametrize("b", [1e-6, 1e-4, 4e-3])
def test_narrow_parallelograms_have_the_exact_variant(b):
    assert_generates(shaped(b=b), exact=True)


@pytest.mark.parametrize("b", [1e-6, 1e-4, 4e-3])
def test_narrow_parallelograms_are_written_and_load(b):
    assert_generates(shaped(b=b), exact=False)


def test_thin_plates_are_written_and_load():
    assert_generates(of_solids(shaped(b=1e-4).geometry), exact=False)


def test_what_cannot_be_given_a_mass_says_so_and_has_the_exact_variant():
    parameters = shaped(L=1000.0)
    with pytest.raises(ModelError, match="write the exact variant"):
        description.texts(parameters)
    assert_generates(parameters, exact=True)
