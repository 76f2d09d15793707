"""Sine and cosine in generated C that are the same on every machine."""

from __future__ import annotations

import re
from importlib.resources import files

from p3dof.codegen.filling import fill

_HEX = re.compile(r"0x[0-9a-f.]+p[+-]?\d+")


def wave() -> str:
    """Return C of ``sincos_one``, sine and cosine of a double, in decimal numbers."""
    text = (files("p3dof._base.tracing") / "sincos.h").read_text(encoding="utf-8")
    code = text[text.index("static P3DOF_INLINE") :]
    code = _HEX.sub(lambda found: repr(float.fromhex(found[0])), code)
    for name, real in (
        ("P3DOF_INLINE P3DOF_TARGET ", ""),
        ("P3DOF_NAME(sincos)", "sincos_one"),
        ("P3DOF_NAME(sincos_near)", "sincos_near"),
        ("P3DOF_REAL_OF", "double_of"),
        ("P3DOF_BITS_OF", "bits_of"),
        ("P3DOF_REAL", "double"),
        ("P3DOF_BITS", "uint64_t"),
        ("P3DOF_BOUNDED(x, reduced)", "(fabs(x) <= 1e5) ? reduced : (double)NAN"),
    ):
        code = code.replace(name, real)
    return fill("loop_sincos.in", sincos=code.rstrip())
