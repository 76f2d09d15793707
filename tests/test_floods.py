"""Pages in notebooks under floods of garbage: they still answer."""

from __future__ import annotations

import contextlib
import json
import logging
import random
import threading

import numpy as np
import pytest
from damage import damaged

pytest.importorskip("meshcat", reason="meshcat not installed")

from test_cli_show import GALLERY

from p3dof.page.encoding import decoded
from p3dof.viewer.messages import unpacked_message
from p3dof.viewer.session import Session

QUESTIONS = 400


def asked(document, number=1):
    """The question of a page where the robot stands."""
    (time, *_), q = document["runs"][0]["time"]["shape"], decoded(document["runs"][0]["q"])[0].tolist()
    assert time >= 1
    inputs = {one["key"]: one["value"] for one in document["inputs"]}
    return {"type": "ask", "id": number, "q": q, "inputs": inputs}


def test_a_widget_answers_after_a_flood(caplog):
    """Whatever a notebook passes on, of views that come and go."""
    pytest.importorskip("anywidget", reason="anywidget is not installed")
    from p3dof import load_robot
    from p3dof.page import RobotFigure, robot_document
    from p3dof.viewer.robots.answers import RobotAnswers
    from p3dof.viewer.widget import PageWidget

    robot = load_robot(GALLERY / "five_bar.urdf")
    document = robot_document(robot, RobotFigure(robot, GALLERY / "five_bar.urdf"))
    session = Session(document, RobotAnswers(robot, decoded(document["runs"][0]["q"])[0]))
    widget, sent, rng = PageWidget(session, lambda: "<p>page</p>"), [], random.Random(2)  # noqa: S311 - no secret
    widget.send = lambda content, buffers=None: sent.append((content, buffers or []))
    plain = {"view": "1", "message": asked(document)}
    try:
        with caplog.at_level(logging.WARNING):
            for _ in range(QUESTIONS):
                with contextlib.suppress(ValueError, RecursionError):  # what is no JSON never gets here
                    widget._received(None, json.loads(damaged(json.dumps(plain).encode(), "json", rng)), [])
            widget._received(None, {"view": "2", "message": asked(document, 7)}, [])
            ended = threading.Event()
            session._work.put("end", ended.set)
            assert ended.wait(60)
        assert caplog.records == []
        told = [unpacked_message(parts[0]) for content, parts in sent if content.get("view") == "2"]
        assert told[-1]["id"] == 7
        assert np.isfinite(told[-1]["q"]).all()
    finally:
        session.stop()
