"""What the README says runs, and it is short."""

from documents import ROOT, blocks, commands, run

import p3dof

README = ROOT / "README.md"


def test_what_it_says_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    session = run(README, tmp_path)
    assert session["result"].forces.shape == (1001, 3)
    assert session["closed"].mobility(session["closed"].assemble().q) == 3
    assert capsys.readouterr().out.count("the methods agree") == 2
    for name in ("forces.csv", "forces.png"):
        assert (tmp_path / "out/loaded" / name).exists()


def test_it_is_a_front_page():
    """Two commands, forces in five lines, MeshCat in one, a table of four doors, one line on speed."""
    text = README.read_text(encoding="utf-8")
    assert len(text.split()) <= 700
    console = [block.text for block in blocks(README) if block.language == "console"]
    assert [line[:2] for block in console for line in block.splitlines()] == ["$ ", "$ "]
    assert len(commands(README)) == 1
    python, urdf = (block.text for block in blocks(README) if block.language == "python")
    first, *lines = [line for line in python.splitlines() if line]
    assert first == "import p3dof"
    assert len(lines) == 5
    assert len(urdf.splitlines()) == 1
    # It opens a browser, so that its own tests run it.
    assert [block.text for block in blocks(README) if block.language == "text"] == [
        "robot.viewer().play(motion)\n"
    ]
    assert callable(p3dof.Manipulator.viewer)
    table = text.partition("| door |")[2].partition("\n\n")[0].splitlines()[2:]
    assert [row[3:].partition("]")[0] for row in table] == [
        "Tutorials",
        "How-to guides",
        "Reference",
        "Explanation",
    ]
    assert text.count("`pin.rnea`") == 1
