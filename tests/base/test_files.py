"""Files are read within bounds, and written whole or not at all."""

import contextlib
import io
import os
import re
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from p3dof._base.errors import FileError, InputError, ParameterError
from p3dof._base.files import (
    SUFFIXES,
    check_generated,
    check_writable,
    parse_yaml,
    read_text,
    suffix_of,
    together,
    write_atomic,
)
from p3dof._base.files.writing import sweep

NAMES = [
    "plain.txt",
    "with space.txt",
    "Größe θ – 模型.txt",
    ".hidden",
    "a" * 200 + ".txt",
    "-dash",
    "no_suffix",
]


@pytest.mark.parametrize("name", NAMES)
def test_round_trip(tmp_path, name):
    path = write_atomic(tmp_path / name, "θ = 1\nzwei\n")
    assert path == tmp_path / name
    assert path.read_bytes() == "θ = 1\nzwei\n".encode()
    assert read_text(path) == "θ = 1\nzwei\n"
    assert read_text(str(path)) == "θ = 1\nzwei\n"
    assert os.listdir(tmp_path) == [name]  # noqa: PTH208 - the bare names are what is compared


def test_bytes_are_written_as_they_are(tmp_path):
    content = bytes(range(256))
    assert write_atomic(tmp_path / "b.bin", content).read_bytes() == content


def test_parent_folders_are_made(tmp_path):
    path = write_atomic(tmp_path / "a" / "b c" / "d.txt", "x")
    assert path.read_text() == "x"


def test_a_relative_path_and_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_atomic("here.txt", "x")
    assert (tmp_path / "here.txt").read_text() == "x"


@pytest.mark.parametrize("mode", [0o600, 0o644, 0o640, 0o755])
def test_an_existing_file_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "f.txt"
    path.write_text("old")
    path.chmod(mode)
    write_atomic(path, "new")
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_new_file_follows_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        path = write_atomic(tmp_path / "f.txt", "new")
        assert os.umask(0o027) == 0o027  # and leaves it as it was
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_the_umask_of_the_process_is_left_alone(tmp_path, monkeypatch):
    def refuse(_mask):
        raise AssertionError("another thread would have made its files for everybody meanwhile")

    monkeypatch.setattr("os.umask", refuse)
    write_atomic(tmp_path / "f.txt", "new")


@pytest.mark.parametrize("target", ["os.fsync", "pathlib.Path.replace", "os.fdopen", "os.open"])
@pytest.mark.parametrize("existing", [True, False])
def test_a_failed_write_leaves_everything_as_it_was(tmp_path, monkeypatch, target, existing):
    path = tmp_path / "f.txt"
    if existing:
        path.write_text("old")

    def fail(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(target, fail)
    with pytest.raises(FileError, match=r"f\.txt: cannot be written \(No space left on device\)"):
        write_atomic(path, "new")
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == ([path] if existing else [])
    if existing:
        assert path.read_text() == "old"


def test_an_interrupted_write_leaves_no_temporary_file(tmp_path, monkeypatch):
    path = tmp_path / "f.txt"
    path.write_text("old")

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_parent_is_a_file(tmp_path):
    parent = tmp_path / "file"
    parent.write_text("old")
    for path in (parent / "f.txt", parent / "deeper" / "f.txt"):
        with pytest.raises(FileError, match="cannot be written"):
            write_atomic(path, "new")
    assert parent.read_text() == "old"


def test_the_target_is_a_folder(tmp_path):
    with pytest.raises(FileError, match=r"cannot be written \(it is a folder\)"):
        write_atomic(tmp_path, "new")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    with pytest.raises(FileError, match="Permission denied"):
        write_atomic(folder / "f.txt", "new")
    folder.chmod(0o700)
    assert not list(folder.iterdir())


def test_a_name_that_is_too_long(tmp_path):
    with pytest.raises(FileError, match="too long"):
        write_atomic(tmp_path / ("a" * 300), "new")
    with pytest.raises(FileError, match="too long"):
        read_text(tmp_path / ("a" * 300))


def test_a_null_byte_in_the_name(tmp_path):
    for act in (read_text, lambda path: write_atomic(path, "new")):
        with pytest.raises(FileError):
            act(f"{tmp_path}/a\0b")


@pytest.mark.parametrize("path", [None, 5, b"f.txt", ["f.txt"], object()])
def test_what_is_no_path(path):
    for act in (read_text, lambda path: write_atomic(path, "new")):
        with pytest.raises(FileError, match="expected the path of a file, got"):
            act(path)


@pytest.mark.parametrize("path", ["text\nof a file\n" * 10_000, "a" * 1_000_000], ids=["lines", "long"])
def test_the_content_given_for_the_path_is_not_repeated(path):
    with pytest.raises(FileError, match="cannot be read") as caught:
        read_text(path)
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)


def test_a_pipe_or_device_is_not_replaced_by_a_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with contextlib.suppress(FileError):
        write_atomic(tmp_path / "pipe", "new")
    assert (tmp_path / "pipe").is_fifo()


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_atomic(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_the_longest_name_that_a_file_may_have(tmp_path):
    write_atomic(tmp_path / ("a" * 255), "new")


def test_a_file_error_is_an_os_error(tmp_path):
    with pytest.raises(OSError, match="cannot be read"):
        read_text(tmp_path / "none")


# ---------------------------------------------------------------- several files, and what others left


def contents(folder):
    return {path.name: path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_files_written_together_are_replaced_at_the_end(tmp_path):
    (tmp_path / "a").write_text("old")
    with together():
        write_atomic(tmp_path / "a", "new")
        write_atomic(tmp_path / "deep" / "b", "new")
        assert (tmp_path / "a").read_text() == "old"
        assert not (tmp_path / "deep" / "b").exists()
        write_atomic(tmp_path / "a", "newer")  # the last one counts
    assert contents(tmp_path) == {"a": "newer", "b": "new"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_between_two_files_leaves_everything_as_it_was(tmp_path, error):
    (tmp_path / "a").write_text("old")

    def write():
        with together():
            write_atomic(tmp_path / "a", "new")
            write_atomic(tmp_path / "deep" / "er" / "b", "new")
            raise error

    with pytest.raises(error):
        write()
    assert contents(tmp_path) == {"a": "old"}
    assert list(tmp_path.iterdir()) == [tmp_path / "a"]  # nor are folders left


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("fails_at", ["a", "b", "c", "d"])
def test_a_file_that_cannot_be_replaced_brings_the_others_back(tmp_path, monkeypatch, fails_at, links):
    before = {"a": "old a", "c": "old c", "d": "old d"}
    for name, text in before.items():
        (tmp_path / name).write_text(text)
    replace = Path.replace

    def sometimes(path, target):
        if Path(target).name == fails_at and path.read_text() == "new":
            raise OSError(16, "Device or resource busy")
        return replace(path, target)

    def no_link(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "replace", sometimes)
    if not links:
        monkeypatch.setattr("os.link", no_link)

    def write():
        with together():
            for name in "abcd":
                write_atomic(tmp_path / name, "new")

    with pytest.raises(FileError, match=f"{fails_at}: cannot be written .Device or resource busy"):
        write()
    assert contents(tmp_path) == before


KILLED = """
import os, signal, sys
from pathlib import Path
from p3dof._base.files import scratch_folder, together, write_atomic
folder = Path(sys.argv[1])
with scratch_folder() as scratch, together():
    (scratch / "page.html").write_text("unfinished")
    write_atomic(folder / "a", "new")
    write_atomic(folder / "b", "new")
    print(scratch, flush=True)
    if sys.argv[2] == "now":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.stdin.read()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_what_a_killed_run_left_is_removed_by_the_next_one_and_nothing_else(tmp_path):
    out, scratch = tmp_path / "out", tmp_path / "scratch"
    out.mkdir()
    scratch.mkdir()
    (out / "a").write_text("old")
    foreign = [out / ".p3dof-mine.tmp", out / ".p3dof-0123456789abcdef.tmp.txt", out / "x.tmp"]
    for path in foreign:
        path.write_text("somebody's")
    (out / ".p3dof-0123456789abcdef.tmp").symlink_to(out / "a")
    kept = set(out.iterdir())
    options = {"env": os.environ | {"TMPDIR": str(scratch)}, "text": True, "stdout": subprocess.PIPE}

    def start(when):
        command = [sys.executable, "-c", KILLED, str(out), when]
        return subprocess.Popen(command, stdin=subprocess.PIPE, **options)

    killed = start("now")
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    left = set(out.iterdir()) - kept
    assert len(left) == 2
    assert len(list(scratch.iterdir())) == 1
    alive = start("later")
    in_use = Path(alive.stdout.readline().strip())
    working = set(out.iterdir()) - kept
    assert len(working) == 2
    assert not working & left  # the living one has swept already
    assert list(scratch.iterdir()) == [in_use]
    another = start("now")  # and spares what the living one works on
    another.communicate()
    sweep(out)
    assert set(out.iterdir()) == kept | working
    alive.communicate("")
    assert alive.returncode == 0
    assert set(out.iterdir()) == kept | {out / "b"}
    assert {path.read_text() for path in foreign} == {"somebody's"}
    assert contents(out)["a"] == "new"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("folder", "it is a folder"),
        ("file/below.csv", "Not a directory"),
        ("file/deep/below.csv", "Not a directory"),
        ("/dev/full", "not a regular file"),
        ("/dev/full/below.csv", "Not a directory"),
        ("/proc/nothing.csv", ""),
        ("a" * 300, "too long"),
        ("new/" + "a" * 300, "too long"),
        ("loop/x", ""),
        ("nul\0", ""),
    ],
)
def test_what_cannot_be_written_is_known_before_the_work(tmp_path, name, message):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("old")
    (tmp_path / "loop").symlink_to("loop")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(FileError, match=f"cannot be written .*{message}"):
        check_writable(tmp_path / name)
    assert sorted(tmp_path.rglob("*")) == before


def test_what_can_be_written_is_not_touched_by_the_question(tmp_path):
    (tmp_path / "file").write_text("old")
    check_writable(tmp_path / "file")
    check_writable(tmp_path / "new" / "deep" / "file")
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


@pytest.mark.parametrize(("kind", "suffixes"), SUFFIXES.items())
def test_the_ending_decides_or_is_refused(kind, suffixes):
    for suffix in suffixes:
        assert suffix_of(f"a/b.x{suffix.upper()}", kind) == suffix
    for name in ("a.xlsx", "a", suffixes[0], f"a{suffixes[0]}.gz", "a."):
        with pytest.raises(InputError, match=re.escape(suffixes[-1])) as caught:
            suffix_of(name, kind)
        assert str(caught.value).startswith(f"{name}: expected a file name that ends in {suffixes[0]}")


# ---------------------------------------------------------------- reading


def test_streams_are_read_within_the_same_bounds():
    assert read_text(io.StringIO("θ\r\n")) == "θ\n"
    assert read_text(io.BytesIO("\ufeffθ".encode())) == "θ"
    with pytest.raises(FileError, match="expected at most 3 bytes"):
        read_text(io.BytesIO(b"0123"), limit=3)
    with pytest.raises(FileError, match="expected UTF-8 text"):
        read_text(io.BytesIO(b"\xff"))


def test_a_missing_file(tmp_path):
    with pytest.raises(FileError, match=r"none\.txt: cannot be read \(No such file or directory\)"):
        read_text(tmp_path / "none.txt")


def test_a_folder_and_a_file_as_a_folder(tmp_path):
    with pytest.raises(FileError, match="cannot be read"):
        read_text(tmp_path)
    (tmp_path / "f").write_text("x")
    with pytest.raises(FileError, match="cannot be read"):
        read_text(tmp_path / "f" / "g")


def test_the_size_limit(tmp_path):
    path = tmp_path / "f.txt"
    path.write_text("0123456789")
    assert read_text(path, limit=10) == "0123456789"
    path.write_text("0123456789+")
    with pytest.raises(FileError, match=r"f\.txt: expected at most 10 bytes"):
        read_text(path, limit=10)


def test_a_byte_order_mark_and_line_ends_are_harmless(tmp_path):
    path = tmp_path / "f.txt"
    path.write_bytes(b"\xef\xbb\xbfone\r\ntwo\rthree\n")
    assert read_text(path) == "one\ntwo\nthree\n"


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"gr\xf6\xdfe", "t,y".encode("utf-16")])
def test_other_encodings_are_refused(tmp_path, content):
    path = tmp_path / "f.txt"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"f\.txt: expected UTF-8 text"):
        read_text(path)


# ---------------------------------------------------------------- YAML


def test_plain_yaml():
    assert parse_yaml("a: [1, 2.5]\nb: {c: text}", "here", ParameterError) == {
        "a": [1, 2.5],
        "b": {"c": "text"},
    }
    assert parse_yaml("", "here", ParameterError) is None


def test_anchors_are_still_yaml():
    text = "base: &base {x: 1, y: 2}\nother: *base"
    assert parse_yaml(text, "here", ParameterError)["other"] == {"x": 1, "y": 2}


def test_merge_keys_are_still_yaml():
    text = "base: &base {x: 1, y: 2}\nother: {<<: *base, y: 3}"
    assert parse_yaml(text, "here", ParameterError)["other"] == {"x": 1, "y": 3}


def test_a_duplicate_key_is_named_where_it_is_repeated():
    with pytest.raises(ParameterError) as caught:
        parse_yaml("a: 1\nb: 2\na: 3\n", "here", ParameterError)
    assert str(caught.value).startswith("here, line 3:")


@pytest.mark.parametrize(
    "text", ["!!map [1]", "!!set [a]", "!!bool x", "!!timestamp abc", "!!int ''", "!!float ''", "!!int '_'"]
)
def test_odd_tags_are_one_clear_error(text):
    with pytest.raises(ParameterError, match="here"):
        parse_yaml(text, "here", ParameterError)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", "here, line [13]: not valid YAML: the key 'a' is given more than once"),
        ("x: {a: 1, a: 1}", "here, line 1: not valid YAML: the key 'a'"),
        ("a: [1, 2\nb: 3", "here, line 2: not valid YAML"),
        ("a: b: c", "here, line 1: not valid YAML"),
        ("\ta: 1", "here, line 1: not valid YAML: found character .*; indent by spaces, YAML takes no tabs"),
        ("a: 1\n---\nb: 2", "here, line 2: not valid YAML"),
        ("!!python/object/apply:os.system ['true']", "here, line 1: not valid YAML"),
        ("a: !!python/name:os.system", "here, line 1: not valid YAML"),
        ("a: !custom 1", "here, line 1: not valid YAML"),
        ("a: \x00", "here: not valid YAML"),
        ("? [1, 2]\n: 3", "here, line 1: not valid YAML"),
        ("? {a: 1}\n: 3", "here, line 1: not valid YAML"),
        ("a: 2024-99-99", "here"),
        pytest.param("[" * 5000, "here", id="deep"),
        ("*unknown", "here, line 1: not valid YAML"),
        ("!!int abc", "here"),
    ],
)
def test_bad_yaml_is_one_clear_error(text, message):
    with pytest.raises(ParameterError, match=message) as caught:
        parse_yaml(text, "here", ParameterError)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#" * 1_000_001, "here: expected at most 1000000 characters of YAML, got 1000001"),
        ("- a\n" * 30_000, "here, line 20000: not valid YAML: expected at most 20000 values"),
        ("a:\n  b: " + "x" * 1001, "here, line 2: .* expected at most 1000 characters a value, got 1001"),
        ("9" * 5000, "here, line 1: .* expected at most 1000 characters a value, got 5000"),
        ("!" + "x" * 100_000 + " 1", "here, line 1: not valid YAML"),
        ("*" + "x" * 100_000, "here, line 1: not valid YAML"),
        ("a:\n  b: !!int ''", "here, line 2: not valid YAML: '' does not fit its type, int"),
        ("a: 2024-99-99", "here, line 1: .* '2024-99-99' does not fit its type, timestamp"),
        ("[" * 5000, "here: not valid YAML: nested too deeply"),
        (None, "here: expected YAML text, got None"),
        (b"a: 1", "here: expected YAML text, got bytes"),
    ],
    ids=range(11),
)
def test_yaml_is_bounded_and_the_error_is_short(text, message):
    with pytest.raises(ParameterError, match=message) as caught:
        parse_yaml(text, "here", ParameterError)
    assert len(str(caught.value)) < 600


def test_a_python_tag_does_nothing(tmp_path):
    path: Path = tmp_path / "made"
    with pytest.raises(ParameterError):
        parse_yaml(f"!!python/object/apply:os.mkdir ['{path}']", "here", ParameterError)
    assert not path.exists()


def test_generated_files_are_compared_line_by_line(tmp_path):
    (tmp_path / "a.c").write_text("one\nx = 1.0;\nthree\n", encoding="utf-8")
    texts = {"a.c": "ONE\nx = 1.001;\nthree\nfour\nfive\n", "b.c": ""}
    path = tmp_path / "a.c"
    expected = [
        f"{path}, line 1: expected 'ONE', got 'one'",
        f"{path}, line 2: expected 'x = 1.001;', got 'x = 1.0;'",
        f"{path}, line 4: expected 'four', got the end of the file",
        f"{tmp_path / 'b.c'}: missing",
    ]
    assert check_generated(texts, tmp_path) == expected
    assert check_generated(texts, tmp_path, relative=2e-3) == [expected[0], *expected[2:]]
    assert check_generated({"a.c": "one\n"}, tmp_path) == [
        f"{path}, line 2: expected the end of the file, got 'x = 1.0;'"
    ]
