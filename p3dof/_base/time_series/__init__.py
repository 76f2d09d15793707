"""Numbers over time, of any robot: sample times, CSV columns, splines, smoothing, wrenches."""
