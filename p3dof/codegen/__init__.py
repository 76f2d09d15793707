"""Generated C: the package's own batch kernels, and libraries for a user's controller.

`batch` prints the kernels of `p3dof.closed_form.compiled`, `controller` everything for a controller:
`routines` are the formulas, `printing` turns them into C, `selftest` makes the program that tests it. `loops`
does the same for any robot, and `frame` is what the two share.
"""
