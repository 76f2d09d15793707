"""What the README says runs, and it is short."""

from documents import ROOT, blocks, commands, run

README = ROOT / "README.md"


def test_what_it_says_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    session = run(README, tmp_path)
    assert session["result"].forces.shape == (1001, 3)
    assert "the methods agree" in capsys.readouterr().out
    for name in ("forces.csv", "forces.png", "machine.html", "c/p3dof.h"):
        assert (tmp_path / "out" / name).exists()


def test_it_is_a_front_page():
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 150
    assert len(commands(README)) == 5
    (python,) = (block.text for block in blocks(README) if block.language == "python")
    first, *lines = [line for line in python.splitlines() if line]
    assert first == "import p3dof"
    assert len(lines) == 5
