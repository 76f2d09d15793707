"""Model files that come with the package: names, and paths that tools and `load_robot` take."""

from __future__ import annotations

import runpy
import shutil
import sys
from pathlib import Path

import pytest
from command_line import run
from documents import ROOT
from gallery import GALLERY, MOBILITY

import p3dof
from p3dof import model_files
from p3dof._base.model_files import in_gallery
from p3dof.machine.description import FORMATS


def test_every_format_has_a_name_and_is_the_file_that_export_writes():
    files = {"sidecar": "p3dof.yaml"} | {name: next(iter(files)) for name, files in FORMATS.items()}
    assert {name: Path(model_files.path(name)).name for name in files} == files
    robots = [f"gallery/{name}" for name in sorted(MOBILITY)]
    assert sorted(model_files.NAMES) == sorted([*files, *robots])
    assert all(Path(model_files.path(name)).is_file() for name in model_files.NAMES)
    told = [sorted(files) for files in FORMATS.values()]
    assert {path.name for path in Path(model_files.PACKAGE_PATH).iterdir()} == {
        one for all_ in told for one in all_
    }


def test_paths_are_named_as_those_of_robot_descriptions():
    for name in ("urdf", "mjcf", "srdf"):
        assert getattr(model_files, f"{name.upper()}_PATH") == model_files.path(name)
    folder = Path(model_files.URDF_PATH).parent
    assert str(folder) == model_files.PACKAGE_PATH
    assert str(folder.parent) == model_files.REPOSITORY_PATH
    assert all(isinstance(value, str) for name, value in vars(model_files).items() if name.endswith("_PATH"))


@pytest.mark.parametrize(
    "name", ["URDF", "gallery", "gallery/steward", "gallery/../urdf", "", None, 1, ["urdf"]]
)
def test_another_name_is_refused(name):
    with pytest.raises(p3dof.InputError, match=r"^name: expected one of urdf, sidecar, .*, got ") as error:
        model_files.path(name)
    assert ("did you mean 'gallery/stewart'" in str(error.value)) == (name == "gallery/steward")


def test_a_wheel_has_them_in_the_package(tmp_path):
    package = tmp_path / "p3dof"
    for kind in ("_base", "models/urdf", "models/gallery"):
        (package / kind).mkdir(parents=True)
    (package / "models/gallery/own.urdf").touch()
    shutil.copy(ROOT / "p3dof/_base/model_files.py", package / "_base")
    found = runpy.run_path(str(package / "_base/model_files.py"))
    assert found["PACKAGE_PATH"] == str(package / "models/urdf")
    assert found["URDF_PATH"] == str(package / "models/urdf/p3dof.urdf")
    assert found["path"]("gallery/own") == str(package / "models/gallery/own.urdf")
    assert found["NAMES"][-1] == "gallery/own"


@pytest.fixture
def empty(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", sorted(MOBILITY))
@pytest.mark.usefixtures("empty")
def test_a_robot_of_the_gallery_is_loaded_by_its_name(name):
    there = p3dof.load_robot(GALLERY / f"{name}.urdf")
    for robot in map(p3dof.load_robot, (f"gallery/{name}", name)):
        assert robot.model == there.model
        assert robot.actuated == there.actuated
        assert len(robot.constraint_models) == len(there.constraint_models)


@pytest.mark.usefixtures("empty")
def test_a_name_that_comes_close_is_told_without_the_extra_too(monkeypatch):
    monkeypatch.setitem(sys.modules, "example_robot_data", None)
    with pytest.raises(p3dof.errors.MissingExtraError, match=r"models\]'; did you mean 'stewart'\?$"):
        p3dof.load_robot("stewrt")
    with pytest.raises(p3dof.errors.MissingExtraError, match=r"pip install 'p3dof\[models\]'$"):
        p3dof.load_robot("panda")


def test_a_file_that_is_there_is_not_taken_for_the_name_of_a_robot(empty):
    for ending in ("urdf", "yaml"):
        shutil.copy(GALLERY / f"five_bar.{ending}", empty / f"stewart.{ending}")
    with pytest.raises(p3dof.ModelError, match=r"no robot by name; did you mean 'stewart[.]urdf'"):
        p3dof.load_robot("stewart")
    shutil.copy(GALLERY / "five_bar.urdf", empty / "stewart")
    assert p3dof.load_robot("stewart", GALLERY / "five_bar.yaml").model.name == "five_bar"


def test_a_file_that_is_there_goes_before(empty):
    (empty / "gallery").mkdir()
    shutil.copy(GALLERY / "five_bar.urdf", empty / "gallery/stewart.urdf")
    shutil.copy(GALLERY / "five_bar.yaml", empty / "gallery/stewart.yaml")
    assert p3dof.load_robot("gallery/stewart.urdf").model.name == "five_bar"
    assert p3dof.load_robot("gallery/stewart").model.name == "stewart"
    assert p3dof.load_robot(Path("gallery/delta.urdf")).model.name == "delta"
    assert in_gallery("gallery\\delta.urdf") == model_files.path("gallery/delta")  # as Windows writes it
    with pytest.raises(p3dof.ModelError, match="no robot of the gallery"):
        in_gallery(f"gallery/{'x' * 92}")
    assert (
        in_gallery(f"gallery/{'x' * 93}")
        is in_gallery(f"gallery/{'x' * 5000}")
        is in_gallery("galleries/delta")
        is in_gallery("delta")
        is None
    )


@pytest.mark.usefixtures("empty")
def test_a_robot_that_is_not_in_the_gallery_is_named():
    with pytest.raises(
        p3dof.ModelError, match=r"^'gallery/steward' is no file and no robot of the gallery; did"
    ):
        p3dof.load_robot("gallery/steward")
    with pytest.raises(p3dof.ModelError, match=r"gallery/steward\.urdf: cannot be read"):
        p3dof.load_robot("gallery/steward.urdf")


@pytest.mark.usefixtures("empty")
def test_commands_take_the_names(capsys):
    assert run(capsys, "loop", "export", "gallery/four_bar", "--out", "four_bar.xml")[0] == 0
    assert Path("four_bar.xml").is_file()
    ros = ["loop", "export", "gallery/four_bar", "--format", "ros2", "--out", "ros"]
    assert run(capsys, *ros)[0] == 0
    Path("four_bar.urdf").write_bytes((GALLERY / "four_bar.urdf").read_bytes())
    assert (
        run(capsys, "loop", "export", "four_bar.urdf", str(GALLERY / "four_bar.yaml"), *ros[3:-1], "other")[0]
        == 0
    )
    there = [sorted(path.relative_to(one) for path in Path(one).rglob("*.*")) for one in ("ros", "other")]
    assert there[0] == there[1] != []
    for path in there[0]:
        assert (Path("ros") / path).read_bytes() == (Path("other") / path).read_bytes()
    code, _, error = run(capsys, "loop", "info", "gallery/four_bars")
    assert (code, error.count("\n")) == (2, 1)
    assert "did you mean 'gallery/four_bar'" in error


@pytest.mark.parametrize("command", ["export --check --format urdf", "urdf --check"])
def test_a_check_outside_a_checkout_is_of_the_files_of_the_package(command, empty, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "300")
    code, out, error = run(capsys, *command.split())
    assert (code, out) == (0, f"{model_files.PACKAGE_PATH}: up to date\n")
    assert error == "p3dof: there is no folder urdf here: the files that come with p3dof are checked\n"
    shutil.copytree(ROOT / "urdf", empty / "urdf")
    assert run(capsys, *command.split()) == (0, "urdf: up to date\n", "")
    (empty / "urdf/p3dof.urdf").unlink()
    assert run(capsys, *command.split())[0] == 1
    shutil.rmtree(empty / "urdf")
    assert run(capsys, *command.split(), "--out", "urdf")[0] == 1  # asked for by name
