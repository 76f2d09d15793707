"""What files of other people say of a robot's loops, as closures, couplings and actuated joints."""
