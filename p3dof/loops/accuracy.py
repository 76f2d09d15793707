"""How exact results are: what single samples, many samples and compiled dynamics measure by, said once.

Who decides (single samples, by singular value decompositions) refuses by `ACCURACY`. Faster ways keep what is
`SURELY` within it, whatever norm it is measured in, and hand all else over: so all refuse the same samples.
"""

from __future__ import annotations

ACCURACY = 1e-9
"""Largest error of an equation of motion, relative to the forces in it, or of rates, relative to these."""
SURELY = ACCURACY / 10.0
"""The same for ways that hand over what they are not sure of."""
NO_CHANGE = 1e-13
"""Change of forces or accelerations, relative to them, or error likewise, that nothing is refined for."""
WELL = 1e-5
"""Least reciprocal condition number of what faster ways solve, for ten digits and more."""
NORMALISED = 1e-6
"""Largest error of the length of quaternions and circles in configurations."""
