"""What the pages of the documentation say runs, and what they point to is there."""

import re
import shutil
import subprocess
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from documents import ROOT, WALKED, blocks, commands, run

import p3dof

DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "generated" not in path.parts)
ELSEWHERE = {"gallery.md": "test_gallery.py", "examples.md": "test_short_examples.py"}
"""Pages that another test runs, and reads the numbers of."""
_LONG = "gpu", "better-machines", "choose-drives", "drives-and-bearings", "workspace-and-indices"
_LONG += ("clearance",)
_LONG += "derivatives-of-any-robot", "plan-a-task", "sweeps-of-millions", "see-any-robot", "excitation"
SLOW = dict.fromkeys((f"{stem}.md" for stem in _LONG), pytest.mark.slow)
"""Other tests hold what these say, and they take long."""
_ADAPTED = ("casadi", "crocoddyl", "fmpy", "gymnasium", "mink", "pink")
LIBRARIES = {"jax": "jax", "rerun": "interop", **dict.fromkeys(_ADAPTED, "adapters")}
"""What the blocks of a page import, also as the beginning of an example's name, and where it is from."""
TOLD = [page for page in PAGES if commands(page) or any(block.language == "python" for block in blocks(page))]
RUN = [page for page in TOLD if page not in WALKED and page.name not in ELSEWHERE]


def need_tools(page, *tools):
    """Skip a page whose commands need what is not here."""
    if any("--wasm" in command for command in commands(page)):
        tools += ("clang", "wasm-ld")
    text = "\n".join(block.text for block in blocks(page) if block.language == "python")
    for library, extra in LIBRARIES.items():
        if re.search(rf"^ *(import|from) {library}", text, re.MULTILINE):
            pytest.importorskip(library, reason=f"{library} not installed: pip install 'p3dof[{extra}]'")
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} not installed")


def name(page):
    return str(page.relative_to(DOCS))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Run a page, once for all tests, and return its folder."""

    @cache
    def folder_of(page):
        folder = tmp_path_factory.mktemp(page.stem)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            run(page, folder)
        return folder

    return folder_of


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=SLOW.get(page.name, ())) for page in RUN], ids=map(name, RUN)
)
def test_what_a_page_says_runs(page, ran):
    need_tools(page)
    ran(page)


def test_pages_are_run():
    assert {"index.md", "how-to/your-own-machine.md", "how-to/motion-files.md"} <= set(map(name, TOLD))
    assert len(TOLD) - len(RUN) == len(WALKED) + len(ELSEWHERE) == 7
    assert sum(len(commands(page)) for page in RUN) >= 10
    for page, test in ELSEWHERE.items():
        (path,) = (ROOT / "tests").glob(f"*/{test}")
        assert re.search(rf"(run|blocks)\(ROOT / \"docs/.*{page}\"", path.read_text(encoding="utf-8"))


def test_the_parameter_file_is_one(tmp_path):
    """The complete example is the paper's machine, with an inertia about the joint as the paper prints it."""
    page = blocks(DOCS / "how-to/your-own-machine.md")
    (text,) = (block.text for block in page if block.text.startswith("# machine.yaml"))
    (tmp_path / "machine.yaml").write_text(text, encoding="utf-8")
    parameters = p3dof.read_parameters(tmp_path / "machine.yaml")
    assert parameters.geometry == p3dof.PAPER.geometry
    expected = p3dof.PAPER.bodies.leg_a.inertia
    np.testing.assert_allclose(parameters.bodies.leg_a.inertia, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("page", "folder"),
    [("how-to/controller-in-c.md", "out/c"), ("how-to/compile-any-robot.md", "out/five_bar")],
)
def test_the_c_of_a_controller_compiles(ran, page, folder):
    page = DOCS / page
    need_tools(page, "cc")
    folder = ran(page) / folder
    (text,) = (block.text for block in blocks(page) if block.language == "c")
    includes, body = text.split("\n\n", 1)
    source = f"{includes}\nvoid stop(void);\nvoid period(void);\nvoid period(void)\n{{\n{body}}}\n"
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", f"-I{folder}", "-xc", "-"]
    # In the text the state has no values yet: that it is read is all that the compiler may find.
    command.insert(4, "-Wno-maybe-uninitialized")
    done = subprocess.run(command, input=source, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_controllers_of_any_robot_hold_it(ran, monkeypatch):
    """Whole programs: errors vanish, and forces are those of the robot with what it carries."""
    page = DOCS / "how-to/control-any-robot-from-c.md"
    need_tools(page, "cc")
    folder = ran(page)
    monkeypatch.chdir(folder)
    told = {}
    for block in blocks(page):
        if block.language != "c":
            continue
        (program,) = re.match(r"/\* (\w+)\.c: ", block.text).groups()
        robot = program.removesuffix("_control")
        (folder / f"{program}.c").write_text(block.text, encoding="utf-8")
        warnings = ["-std=c99", "-O0", "-Wall", "-Wextra", "-Werror", "-pedantic"]
        sources = [f"-Iout/{robot}", f"{program}.c", f"out/{robot}/{robot}.c", "-o", program, "-lm"]
        done = subprocess.run(["cc", *warnings, *sources], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        done = subprocess.run([folder / program], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout
        lines = done.stdout.splitlines()
        numbers = [re.findall(r"-?\d+\.\d+(?:e[-+]\d+)?", line) for line in lines]
        told[robot] = np.array(numbers, dtype=float)
    time, error = told["five_bar"][:, :2].T
    np.testing.assert_array_equal(time, [0, 0.25, 0.5, 0.75, 1])
    assert error[0] == 0.05
    assert error[1] < 1e-3
    assert error[2:].max() < 1e-4
    assert told["stewart"][:, 1].max() < 3e-5
    robot = p3dof.load_robot("gallery/stewart.urdf")
    robot.model.inertias[robot.model.getJointId("platform_free")] += pin.Inertia(
        10.0, np.array([0, 0, 0.05]), np.zeros((3, 3))
    )
    w = 2 * np.pi * 2  # half a second is a whole period: the legs are at home, at rest, and accelerate
    push = 0.02 * np.cos(np.arange(6)) * w**2
    state = robot.complete(np.full(6, 0.585), np.zeros(6), push, robot.assemble().q)
    forces = robot.inverse_dynamics(state.q, state.v, state.a).tau
    np.testing.assert_allclose(told["stewart"][2, -2:], forces[:2], rtol=0, atol=1.0)


@pytest.mark.parametrize("page", ["how-to/controller-in-c.md", "how-to/compile-any-robot.md"])
def test_the_javascript_of_a_page_runs(ran, page):
    page = DOCS / page
    need_tools(page, "node")
    folder = ran(page)
    (text,) = (block.text for block in blocks(page) if block.language == "js")
    (folder / "page.mjs").write_text(text, encoding="utf-8")
    done = subprocess.run(["node", "page.mjs"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("OK") == text.count("statuses[")
    assert "NaN" not in done.stdout


def test_blocks_that_are_not_run_are_few():
    """Of the pages' languages, only these hold something that no test runs."""
    languages = {block.language for page in PAGES for block in blocks(page)}
    assert languages <= {"python", "console", "yaml", "text", "c", "js", "csv"}


def test_times_told_to_choose_by_are_those_that_were_measured():
    said, measured = ((DOCS / f"explanation/{page}.md").read_text("utf-8") for page in ("choosing", "speed"))
    rows = {
        "pinocchio": "inverse_dynamics, 1,001",
        "virtual-power": "inverse_dynamics, virtual power, 1,001",
        "compiled": "inverse_dynamics, compiled, 100,000",
    }
    for method, call in rows.items():
        (time,) = re.findall(rf'^\| `"{method}"` \|.*?\| (\d[^|]*) \|', said, re.MULTILINE)
        assert f"\n| {call} | {time} a sample |" in measured, method
    assert list(rows) == list(p3dof.methods.METHODS)


def test_the_pdf_begins_with_title_contents_and_front_page():
    etree = pytest.importorskip("lxml.etree", reason="lxml not installed: pip install 'p3dof[shapes]'")
    from as_pdf import printable

    chapter = """<span id="document-{0}/index"></span><section id="{0}">
        <h2>{0}<a class="headerlink" href="#{0}">#</a></h2>
        <p>of {0}</p><div class="toctree-wrapper"><span id="document-{0}/page"></span>
        <section id="page"><h3>Page of {0}</h3><iframe src="a.html"></iframe></section></div></section>"""
    chapters = "".join(map(chapter.format, ("guides", "reference")))
    page = f"""<html><head></head><body><header>menu</header><article><section id="p3dof"><h1>p3dof</h1>
        <div class="toctree-wrapper">{chapters}</div><p>front page</p></section></article>
        <script>print()</script></body></html>"""
    made = etree.HTML(printable(page))
    found = [
        "".join(text.itertext()).strip()
        for text in made.xpath("//article//*[self::h1 or self::h2 or self::h3 or self::p]")
    ]
    contents = ["guides", "Page of guides", "reference", "Page of reference"]
    assert found[0] == "p3dof"
    assert found[2].endswith(p3dof.__version__)
    assert found[3:9] == ["Contents", *contents, "front page"]
    assert found[9:] == [
        "guides",
        "of guides",
        "Page of guides",
        "reference",
        "of reference",
        "Page of reference",
    ]
    aims = made.xpath("//div[@id='contents']//a/@href")
    assert [made.xpath(f"//*[@id='{aim[1:]}']/following-sibling::section[1]/@id")[0] for aim in aims] == [
        "guides",
        "page",
        "reference",
        "page",
    ]
    assert not made.xpath("//iframe | //script | //header | //a[@class='headerlink']")


def test_each_guarantee_names_tests_that_are_there():
    text = (DOCS / "explanation/guarantees.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| ") and "guaranteed" not in line]
    for row in rows:
        named = re.findall(r"`(test_\w+\.py)::(test_\w+)`", row.split(" | ")[-1])
        assert named, row
        for file, test in named:
            (path,) = (ROOT / "tests").glob(f"*/{file}")
            assert f"\ndef {test}(" in path.read_text(encoding="utf-8"), (file, test)
    assert len(rows) > 20
