"""Dynamics of any robot with loops, compiled: its formulas are traced once, loops included."""
