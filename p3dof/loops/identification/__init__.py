"""From measured motions to a model of any robot: excitation, logs, estimates, validation, calibration."""
