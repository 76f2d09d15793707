"""The paper's formulas, its equations (1)-(18), on scalars: numbers, columns of arrays, or symbols.

Nothing here makes an array, checks an argument or knows Pinocchio; `p3dof.closed_form.kinematics` and
`p3dof.methods` serve arrays with these formulas, `p3dof.closed_form.compiled` folds and compiles them.
"""
