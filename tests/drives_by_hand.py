"""Drives, and what a cycle takes of them by sums over its samples."""

from __future__ import annotations

import math

import numpy as np

import p3dof
from p3dof.design.drives import Belt, Drive, Gear, Motor, Screw

RPM = math.pi / 30
GEARED = Drive(
    Motor(
        0.5, 1.4, 500.0, 4e-5, 250.0, brake_torque=0.9, coupling_inertia=1e-5, drag=0.02, time_constant=0.8,
        max_inertia_ratio=30.0, max_power=240.0, max_braking_power=30.0,
    ),
    Screw(0.016, 0.85, inertia=6e-5, diameter=0.011, length=0.7, drag=0.03, max_speed=110.0),
    Gear(2.5, 0.93, inertia=2e-5, max_speed=420.0, max_torque=1.1),
    "geared",
)  # fmt: skip
BELTED = Drive(
    Motor(2.0, 6.0, 300.0, 3e-4, 200.0, brake_torque=4.0, max_inertia_ratio=25.0),
    Belt(0.05, 0.9, 0.8, 5e-4, 0.1),
    name="belted",
)
PLAIN = Drive(
    Motor(1.0, 3.0, 400.0, 9e-5, time_constant=20.0),
    Screw(0.01, diameter=0.012, length=0.9, ends="fixed-free"),
    name="plain",
)
BACK = {"geared": (2 - 1 / 0.85, 2 - 1 / 0.93), "belted": (0.8, 1.0), "plain": (2 - 1 / 0.9, 1.0)}
SLOW = {"geared": 6e-5, "belted": 5e-4, "plain": math.pi * 7850 * 0.012**4 * 0.9 / 32}
TURN = {"geared": 2 * math.pi / 0.016, "belted": 40.0, "plain": 2 * math.pi / 0.01}
WHIRL = {"geared": (15.418206, 0.7, 0.011, 2.045748), "plain": (3.516015, 0.9, 0.012, 0.25)}

D1 = Drive(Motor(1.6, 30.0, 1e4, 1e-4, time_constant=30.0), Screw(0.01, 0.9, 0.888889, inertia=2e-4))
D2 = Drive(Motor(1.6, 30.0, 1e4, 0.5e-4), Screw(0.02, 0.9, 0.888889, inertia=1e-4))
"""The reference drives; their numbers were computed elsewhere: by Pinocchio with trapezoids, and by virtual
power with Gauss quadrature."""


def slowed(samples):
    """The paper's path from rest to rest in one second."""
    tau = np.linspace(0, 1, samples)
    t = tau**3 * (10 + tau * (6 * tau - 15))
    rate, change = 30 * (tau * (1 - tau))[:, None] ** 2, (60 * tau * (1 - tau) * (1 - 2 * tau))[:, None]
    w = 4 * np.pi
    pose = np.column_stack(
        [-(t**2) * (t**2 - 1.3 * t + 0.3), 0.2 * t**2 * (2 * t**2 - t - 1), 0.4 * np.sin(w * t)]
    )
    slope = np.column_stack(
        [-t * (4 * t**2 - 3.9 * t + 0.6), 0.2 * t * (8 * t**2 - 3 * t - 2), 0.4 * w * np.cos(w * t)]
    )
    bend = np.column_stack(
        [-(12 * t**2 - 7.8 * t + 0.6), 0.2 * (24 * t**2 - 6 * t - 2), -0.4 * w**2 * np.sin(w * t)]
    )
    return p3dof.Motion(tau, pose, slope * rate, bend * rate**2 + slope * change)


def trapezoids(time, values):
    return sum((b - a) * (u + v) / 2 for a, b, u, v in zip(time, time[1:], values, values[1:], strict=False))


RATIOS = {"geared": 30.0, "belted": 25.0, "plain": 10.0}  # that the control takes; 10 by default
MARGINS = {"heating": 0.36} | dict.fromkeys(
    ("peak torque", "rms torque", "speed", "power", "regeneration", "gear torque", "gear speed"), 0.2
)
"""What must stay free by default."""


class Axis:
    """What a cycle takes of the drive of one axis, sample by sample."""

    def __init__(self, cycle, drive, leg, held, when, masses):
        self.name, motor, gear = drive.name, drive.motor, drive.gear
        self.time = cycle.time.tolist()
        self.rest = cycle.rest
        self.total = self.time[-1] - self.time[0] + self.rest
        turn = TURN[drive.name]
        ratio = turn * gear.ratio
        fast = motor.inertia + motor.coupling_inertia + gear.inertia
        self.mass = fast * ratio**2 + SLOW[drive.name] * turn**2
        f, v, a = (part[:, leg].tolist() for part in (cycle.force, cycle.speed, cycle.acceleration))
        slow, own = drive.transmission, SLOW[drive.name] * turn
        self.screw = [
            self.passed(fk * vk, fk / turn, slow, 0) + own * ak + slow.drag * np.sign(vk)
            for fk, vk, ak in zip(f, v, a, strict=True)
        ]
        self.torque = [
            self.passed(s * vk, s / gear.ratio, gear, 1) + fast * ratio * ak + motor.drag * np.sign(vk)
            for s, vk, ak in zip(self.screw, v, a, strict=True)
        ]
        self.turning = [ratio * vk for vk in v]
        self.power = [t * w for t, w in zip(self.torque, self.turning, strict=True)]
        self.f, self.v, self.a, self.ratio, self.turn = f, v, a, ratio, turn
        self.holding = float(cycle.holding[leg]) / ratio
        self.own = self.mass / ratio
        self.ratios = [m / ratio**2 / motor.inertia for m in masses]
        still = ((cycle.speed == 0) & (cycle.acceleration == 0)).all(axis=1)
        self.still = still[1:] & still[:-1]
        self.ratings = self.ratings_of(drive, 1.5 * held / ratio, when)

    def passed(self, power, torque, stage, kind):
        back = BACK[self.name][kind]
        return torque * (1 / stage.efficiency if power > 0 else back if power < 0 else 1)

    def mean(self, values, resting=0.0):
        return (trapezoids(self.time, [value**2 for value in values]) + resting**2 * self.rest) / self.total

    def at_most(self, values):
        """The largest magnitude, and when."""
        k = max(range(len(values)), key=lambda i: abs(values[i]))
        return abs(values[k]), self.time[k]

    def allowed(self, motor, speed, peak):
        """The usual curve: level up to the rated speed, then straight down to the fastest."""
        low, high = motor.rated_speed, motor.max_speed
        speed = min(abs(speed), high)
        top = motor.peak_torque if peak else motor.rated_torque
        end = motor.rated_torque if peak else motor.rated_torque * low / high
        return top if speed <= low else top + (end - top) * (speed - low) / (high - low)

    def heat(self, motor):
        """The hottest of a cycle of τ ẋ + x = (T / T_c)² after which it begins anew."""
        pairs = zip(self.torque, self.turning, strict=True)
        load = [(t / self.allowed(motor, w, False)) ** 2 for t, w in pairs]
        steps = [
            (b - a, (u + w) / 2) for a, b, u, w in zip(self.time, self.time[1:], load, load[1:], strict=False)
        ]
        steps.append((self.rest, (self.holding / motor.rated_torque) ** 2))
        heat, history = 0.0, [1.0]
        while abs(heat - history[0]) > 1e-13:
            history = [heat]
            for step, value in steps:
                heat = value + (heat - value) * math.exp(-step / motor.time_constant)
                history.append(heat)
        k = history.index(max(history))
        return history[k], [*self.time, math.nan][k]

    def ratings_of(self, drive, brake, when):
        """By name: required, allowed, when."""
        motor, gear, slow = drive.motor, drive.gear, drive.transmission
        pairs = zip(self.torque, self.turning, strict=True)
        shares = [abs(t) / self.allowed(motor, w, True) * (abs(w) <= motor.max_speed) for t, w in pairs]
        k = shares.index(max(shares))
        top, at = self.at_most(self.turning)
        rms_speed = self.mean(self.turning) ** 0.5
        found = {
            "peak torque [N m]": (abs(self.torque[k]), abs(self.torque[k]) / shares[k], self.time[k]),
            "rms torque [N m]": (
                self.mean(self.torque, self.holding) ** 0.5, self.allowed(motor, rms_speed, False), math.nan
            ),
            "speed [rpm]": (top / RPM, motor.max_speed / RPM, at),
        }  # fmt: skip
        turns = top / gear.ratio / RPM
        if self.name in WHIRL:
            squared, length, diameter, factor = WHIRL[self.name]
            whirl = 0.8 * squared / length**2 * math.sqrt(2.1e11 / 7850) * diameter / 4
            found["critical speed [rpm]"] = (turns, whirl / RPM, at)
            euler = math.pi**2 * 2.1e11 * math.pi * diameter**4 / 64 * factor / length**2
            hardest, then = self.at_most(self.f)
            found["buckling [N]"] = (hardest, euler / 2, then)
        if self.name == "plain":
            found["nut speed [rpm]"] = (turns, 5000.0, at)
            found["DN [mm rpm]"] = (1.25 * 12 * turns, 70000.0, at)
        if self.name == "geared":
            found["nut speed [rpm]"] = (turns, slow.max_speed / RPM, at)
            found["gear speed [rpm]"] = (top / RPM, gear.max_speed / RPM, at)
            found["power [W]"] = (max(self.power), 240.0, self.time[self.power.index(max(self.power))])
            least = min(self.power)
            found["regeneration [W]"] = (-least, 30.0, self.time[self.power.index(least)])
            hardest, then = self.at_most(self.screw)
            found["gear torque [N m]"] = (hardest, 1.1, then)
        found["inertia ratio"] = (self.ratios[1], RATIOS[self.name], math.nan)
        if motor.brake_torque:
            found["brake [N m]"] = (brake, motor.brake_torque, when)
        if motor.time_constant:
            heat, then = self.heat(motor)
            found["heating"] = (heat, 1.0, then)
        return found

    def worst(self):
        """Of those that fit least: the largest share, and of what."""
        return max(
            (share > 1, share > 1 - MARGINS.get(name, 0), share, name)
            for name, share in ((n.split(" [")[0], v / a) for n, (v, a, _) in self.ratings.items())
        )[2:]

    def column(self):
        """What `axes_table` tells, in its order."""
        k = max(range(len(self.torque)), key=lambda i: abs(self.torque[i]))
        moving = [
            (b - a) * (u**2 + w**2) / 2
            for i, (a, b, u, w) in enumerate(
                zip(self.time, self.time[1:], self.torque, self.torque[1:], strict=False)
            )
            if not self.still[i]
        ]
        squares = self.mean(self.f, self.holding * self.ratio), self.mean(self.a)
        inertia = self.mass / self.ratio**2
        best = (squares[0] / squares[1] / inertia**2) ** 0.25  # motor's angle by way [rad/m]
        return {
            "peak torque [N m]": self.torque[k],
            "at t [s]": self.time[k],
            "share of inertia there": (self.own * self.a[k] / self.torque[k],),
            "rms torque [N m]": self.mean(self.torque, self.holding) ** 0.5,
            "rms torque, brake closed at rest [N m]": (sum(moving) / self.total) ** 0.5,
            "top speed [rpm]": max(map(abs, self.turning)) / RPM,
            "rms speed [rpm]": self.mean(self.turning) ** 0.5 / RPM,
            "peak power [W]": max(self.power),
            "work supplied [J]": trapezoids(self.time, [max(p, 0) for p in self.power]),
            "work regenerated [J]": trapezoids(self.time, [min(p, 0) for p in self.power]),
            "ratio of load to rotor inertia": (self.ratios[0], "to", self.ratios[1]),
            "lead for minimum rms torque [mm]": 2e3 * math.pi / best * self.ratio / self.turn,
            "reflected mass [kg]": self.mass,
        }
