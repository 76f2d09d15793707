"""Libraries that were compiled before: whatever became of their files, Python neither dies nor runs them."""

import ctypes
import errno
import os
import tempfile

import pytest

from p3dof._base.errors import FileError, ModelError
from p3dof.loops.compiled import build

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler here")

SOURCE = "int answer(void) { return 42; }\n"


@pytest.fixture(autouse=True)
def places(tmp_path, monkeypatch):
    """A cache and a place for temporary files of the test's own."""
    cache, temporary = tmp_path / "cache", tmp_path / "tmp"
    for folder in (cache, temporary):
        folder.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    return cache / "p3dof" / "loops", temporary / f"p3dof-{build._user()}" / "loops"


@pytest.fixture
def compilations(monkeypatch):
    """What the compiler was called for."""
    started, start = [], build._start
    monkeypatch.setattr(build, "_start", lambda *given: started.append(given) or start(*given))
    return started


def answer():
    (library,) = build.libraries([SOURCE])
    assert library.answer() == 42
    return library


def test_what_was_compiled_is_kept_and_found(places, compilations):
    first = answer()
    (kept,) = places[0].iterdir()
    assert answer()._handle == first._handle
    assert len(compilations) == 1
    assert list(places[0].iterdir()) == [kept]


def test_equal_sources_are_compiled_once(compilations):
    one, two = build.libraries([SOURCE, SOURCE])
    assert one.answer() == two.answer() == 42
    assert len(compilations) == 1


DAMAGES = {
    "cut in half": lambda data: data[: len(data) // 2],
    "a page short": lambda data: data[:-4096],
    "empty": lambda _: b"",
    "foreign": lambda _: b"not a library",
    "one bit": lambda data: data[:3000] + bytes([data[3000] ^ 1]) + data[3001:],
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_library_is_compiled_anew_and_healed(damage, places, compilations):
    answer()
    (kept,) = places[0].iterdir()
    data = kept.read_bytes()
    kept.unlink()  # what is loaded stays as it is
    kept.write_bytes(damage(data))
    answer()
    assert len(compilations) == 2
    assert kept.read_bytes() == data
    answer()
    assert len(compilations) == 2


def test_a_library_of_another_source_under_the_name_is_not_run(places, compilations):
    answer()
    (kept,) = places[0].iterdir()
    build.libraries(["int answer(void) { return 13; }\n"])
    (other,) = set(places[0].iterdir()) - {kept}
    data = other.read_bytes()
    kept.unlink()
    kept.write_bytes(data)
    answer()
    assert len(compilations) == 3


def test_a_file_that_is_someone_elses_is_not_run(compilations, monkeypatch):
    answer()
    monkeypatch.setattr(build, "_private", lambda _: True)
    monkeypatch.setattr(build, "_user", lambda: 12345)
    answer()
    assert len(compilations) == 2


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o1777])
def test_code_that_others_could_have_put_there_is_not_run(mode, places, compilations):
    answer()
    (kept,) = places[0].iterdir()
    places[0].chmod(mode)
    answer()
    assert len(compilations) == 2
    assert list(places[0].iterdir()) == [kept]
    assert len(list(places[1].iterdir())) == 1  # the next folder takes it
    answer()
    assert len(compilations) == 2


def test_nor_where_others_could_have_put_another_folder(places, compilations):
    answer()
    places[0].parents[1].chmod(0o777)
    answer()
    assert len(compilations) == 2
    assert oct(places[1].stat().st_mode & 0o777) == "0o700"


def test_nor_in_a_folder_of_another_user(compilations, monkeypatch):
    answer()
    monkeypatch.setattr(build, "_user", lambda: 12345)
    answer()
    answer()
    assert len(compilations) == 3  # nothing is kept then


def test_a_user_without_a_home_has_a_cache_too(places, compilations, monkeypatch):
    import pwd

    def unknown(_):
        raise KeyError

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    answer()
    answer()
    assert len(compilations) == 1
    assert len(list(places[1].iterdir())) == 1


def test_a_cache_by_a_relative_path_is_none(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir(mode=0o700)
    monkeypatch.chdir(tmp_path)
    answer()
    assert not (tmp_path / "here").exists()
    assert len(list((tmp_path / "home/.cache/p3dof/loops").iterdir())) == 1


def test_a_full_disk_loses_no_result_and_leaves_nothing(monkeypatch, places):
    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    answer()
    assert [list(place.iterdir()) for place in places] == [[], []]


def test_what_a_killed_process_left_is_swept(places):
    places[0].mkdir(parents=True, mode=0o700)
    left = places[0] / ".p3dof-0123456789abcdef.tmp"
    left.write_bytes(b"half a library")
    answer()
    assert not left.exists()


def test_a_disk_that_nothing_is_run_from_is_passed_over(monkeypatch, places, compilations):
    load = ctypes.CDLL

    def careful(path):
        if path.startswith(str(places[0])):
            raise OSError("failed to map segment from shared object")
        return load(path)

    monkeypatch.setattr(ctypes, "CDLL", careful)
    answer()
    answer()
    assert len(compilations) == 1
    assert len(list(places[1].iterdir())) == 1


def test_no_place_for_temporary_files_is_told(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    with pytest.raises(FileError, match=r"no folder for temporary files \(Not a directory\)"):
        answer()


def test_a_compiler_that_cannot_be_run_is_told(monkeypatch, tmp_path):
    program = tmp_path / "cc"
    program.write_text("no program")
    monkeypatch.setattr(build, "compiler", lambda: str(program))
    with pytest.raises(ModelError, match=r"the C compiler cannot be run \(.*\)"):
        answer()
