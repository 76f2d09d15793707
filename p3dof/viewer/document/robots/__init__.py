"""Documents of any robot: its shapes, its skeleton, its motion, and the forces on it."""
