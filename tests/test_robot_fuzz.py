"""Robots whose files are broken: each is one clear error in bounded time, or a robot that can be written."""

import random
import re
import time
import warnings

import pytest
import test_robot_files as files
from closed_loop_robots import hexapod
from documents import ROOT

from p3dof.closed_loop import load_robot
from p3dof.closed_loop.writers import mjcf, sdf, urdf
from p3dof.errors import P3dofError

mujoco = pytest.importorskip("mujoco")

WORDS = ("nan", "inf", "-1", "0", "1e308", "1e-320", "", "x", "..", "1 2", "1 2 3", "true", "world", "a", "é")
SIGNS = (*WORDS, "<", "&", '"', "'")


def texts():
    """Return files of every format that are all right."""
    return [
        files.chain(files.ROTOR + files.GEAR + files.loop()),
        files.chain(files.BALL, second='<mimic joint="shoulder"/>'),
        hexapod(),
        *((ROOT / "urdf" / name).read_text("utf-8") for name in ("p3dof_plus.urdf", "p3dof_mjcf.xml")),
    ]


def broken(text, rng):
    """Return a text with a value replaced, a tag lost or doubled, or a few characters changed."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        kind = rng.choice(("value", "value", "lost", "twice", "characters"))
        if kind == "characters":
            place = rng.randrange(len(text))
            text = text[:place] + rng.choice(SIGNS) + text[place + rng.randrange(3) :]
            continue
        found = list(re.finditer({"value": r'"[^"]*"', "lost": "<[^>]*>", "twice": "<[^>]*/>"}[kind], text))
        if not found:
            continue
        part = rng.choice(found)
        new = {"value": f'"{rng.choice(WORDS)}"', "lost": "", "twice": 2 * part.group()}[kind]
        text = text[: part.start()] + new + text[part.end() :]
    return text


def loaded(text):
    """Return what the error says that a text is refused with; nothing if it is a robot."""
    try:
        robot = load_robot(text)
    except P3dofError as error:
        return str(error)
    except Exception as error:
        raise AssertionError(f"this escaped for:\n{text}") from error
    for write in (urdf.texts, mjcf.text, sdf.text, lambda robot: sdf.text(robot, drake=True)):
        try:
            written = write(robot)
            if write is mjcf.text:
                mujoco.MjModel.from_xml_string(written)
        except P3dofError as error:  # noqa: PERF203
            assert "\n" not in str(error)  # noqa: PT017 - most are written
        except Exception as error:
            raise AssertionError(f"this escaped when writing:\n{text}") from error
    return ""


def search(seed, count):
    """Load broken files; fail for one that is not refused by one line in a few seconds."""
    rng, sources, refused = random.Random(seed), texts(), 0  # noqa: S311 - no secret
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # robots that look open
        for _ in range(count):
            text, begun = broken(rng.choice(sources), rng), time.process_time()
            message = loaded(text)
            refused += bool(message)
            assert "\n" not in message
            assert len(message) < 1500
            assert time.process_time() - begun < 5
    assert refused > count / 10


def test_broken_files_are_refused_in_one_line_and_others_are_written():
    search(1, 300)


@pytest.mark.fuzz
def test_very_many_broken_files_are_refused_in_one_line(request):
    search(request.config.getoption("--hypothesis-seed"), 30_000)
