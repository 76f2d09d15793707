"""Any robot with closed loops to look at: rods or its own shapes, its closures, and the forces on it."""
