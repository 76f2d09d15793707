"""Sphinx settings: `make docs` builds the site, offline, with every warning an error."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import p3dof

project = "p3dof"
author = "The p3dof developers"
copyright = author  # noqa: A001 - the name that Sphinx reads
version = release = p3dof.__version__

extensions = [
    "accessible",  # _ext: what axe finds in the pages of Sphinx and its theme
    "from_program",  # _ext: pages made from the program itself
    "formulas",  # _ext: formulas without a network
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build", "_ext", "_templates", "reference/generated"]
templates_path = ["_templates"]
nitpicky = False
suppress_warnings = ["config.cache"]

# Docstrings: NumPy style; one page a public name, signatures with the defaults as they are written.
highlight_language = "text"
default_role = "autolink"
autosummary_generate = True
autodoc_preserve_defaults = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
add_module_names = False
python_display_short_literal_types = True
maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"

# What readers search for that is no title: the page, and perhaps its section, that comes first.
searched = {
    "how-to/urdf-meshcat-forces": {"": "URDF; MeshCat; yourdfpy; example-robot-data; forces"},
    "how-to/your-own-machine": {"": "payload; own machine; dimensions; mass; inertia; CAD"},
    "how-to/motion-files": {"": "degrees; millimetres; units; CSV; own motion; trajectory"},
    "how-to/another-closed-loop-robot": {"": "own robot; closed loop; MJCF; loop closure; MuJoCo model"},
    "how-to/error-messages": {"": "troubleshooting; error; warning; problem; fix"},
    "how-to/gallery": {
        "stewart-platform": "Stewart; Gough; hexapod; 6-UPS",
        "delta-robot": "Delta",
        "five-bar-linkage": "five-bar",
        "four-bar-linkage": "four-bar",
        "robot-on-two-feet": "biped; humanoid",
    },
    "how-to/choose-drives": {"": "motor; screw; gear; belt; torque; drives"},
    "how-to/drives-and-bearings": {"": "bearing; joint reactions; guide; L10; load-dependent friction"},
    "how-to/balance-the-sliders": {"": "counterbalance; gas spring; counterweight; balance"},
    "how-to/better-machines": {"": "optimisation; Pareto front"},
    "how-to/simulation-and-control": {"": "simulation; controller; PD; computed torque"},
    "how-to/workspace-and-indices": {"": "workspace; dexterity; transmission index; stiffness"},
    "how-to/uncertain-machines": {"": "tolerance; sensitivity; Sobol' indices; Monte Carlo; calibration"},
    "benchmark/index": {"": "benchmark; reference solutions; overconstrained; redundantly actuated; RBDL"},
    "explanation/singularities": {"": "singularity; singular configuration; assembly mode"},
}

# Pages in Markdown; notebooks run in the build, and the build fails with them.
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE.parent / "out" / "notebooks")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_ipywidgets_js = {}

# Kernels for the build alone: no settings of the user, no warning that they talk to this machine in the open;
# figures are in the page from the first one on.
profile = HERE.parent / "out" / "ipython" / "profile_default"
profile.mkdir(parents=True, exist_ok=True)
(profile / "ipython_kernel_config.py").write_text(
    "get_config().IPKernelApp.log_level = 40\nget_config().IPKernelApp.matplotlib = 'inline'\n",
    encoding="utf-8",
)
os.environ["IPYTHONDIR"] = str(profile.parent)

html_theme = "pydata_sphinx_theme"
html_title = "p3dof"
html_static_path = ["_static"]
html_css_files = ["p3dof.css"]
html_js_files = [("quiet.js", {"priority": 100})]
html_context = {"default_mode": "auto"}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "p3dof"},
    "show_prev_next": True,
    "navigation_with_keys": False,
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_toc_level": 2,
    "pygments_light_style": "a11y-light",
    "pygments_dark_style": "a11y-dark",
}
html_sidebars = {"index": [], "contributing": [], "tests": [], "changelog": []}
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = True
