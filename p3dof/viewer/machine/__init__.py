"""The paper's machine as a client: its scene, runs, forces and studio, as data for the same page."""
