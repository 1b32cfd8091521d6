# SPDX-License-Identifier: Apache-2.0
"""Lengths, stiffnesses, masses and damping by the free motion of springs, all frames at once.

Springs about a moving wall are strained, in proportion to the square of its speed, so that bonds
do not close. The whole motion follows from its begin: least squares between its angles and the
readings is the likeliest chain under normal noise. It begins with few frames, which any chain
nearly follows, and takes more as it learns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.adjustment import measurable
from soliton_linkage.identification.free_motion import Motion, frames, frames_with_changes
from soliton_linkage.identification.lengths import OF_A_ROTOR, Lengths
from soliton_linkage.identification.tolerances import Tolerances, unknowns_of
from soliton_linkage.linkage.chain import Array

_FIRST = 40
_GROWTH = 1.6
_TOGETHER = 50
_MOST_STEPS = 12


@dataclass(frozen=True)
class MotionFit:
    motion: Motion
    covariance: Array
    noise: float
    left: Array
    tolerances: Tolerances
    of_forces: float


class MotionFitting:
    def __init__(self, times: Array, readings: Array, start: Motion, noise: float, report=print) -> None:
        self.times, self.readings, self.motion = times, readings, start
        self.noise = noise
        self.tolerances, self.of_forces = Tolerances(), 0.3
        self.report = report
        rotors = len(start.masses)
        self.geometry = OF_A_ROTOR * rotors - 2
        size = self.geometry + 4 * rotors
        basis = measurable(start.lengths)
        self.basis = np.zeros((size, size - 2))
        self.basis[: self.geometry, : self.geometry - 1] = basis
        alike = np.linalg.qr(np.ones((rotors, 1)), mode='complete')[0][:, 1:]
        m = self.geometry + rotors - 1
        rest = np.eye(size - self.geometry)
        keep = np.delete(rest, np.arange(rotors - 1, 2 * rotors - 1), axis=1)
        self.basis[self.geometry :, self.geometry - 1 : self.geometry - 1 + keep.shape[1]] = keep
        self.basis[m : m + rotors, -(rotors - 1) :] = alike

    def prior(self, motion: Motion) -> tuple[Array, Array]:
        rotors, g = len(motion.masses), self.geometry
        size = g + 4 * rotors
        information, values = np.zeros((size, size)), np.zeros(size)
        information[:g, :g] = self.tolerances.information(rotors)
        values[:g] = unknowns_of(motion.lengths)
        k = slice(g, g + rotors - 1)
        m = slice(g + rotors - 1, g + 2 * rotors - 1)
        information[k, k] = (np.eye(rotors - 1) - 1 / (rotors - 1)) / self.of_forces**2
        information[m, m] = np.eye(rotors) / self.of_forces**2
        values[k], values[m] = np.log(motion.stiffnesses), np.log(motion.masses)
        c = g + 2 * rotors - 1
        scale = float(np.mean(motion.masses * motion.lengths.rotor_lengths**2))
        information[c, c] = (scale * 1.0) ** -2
        values[c] = motion.damping
        return information, values

    def cost(self, motion: Motion, count: int) -> float:
        angles = np.array(list(frames(motion, self.times[:count])))
        left = self.readings[:count] - motion.lengths.offsets - angles
        information, values = self.prior(motion)
        squares = float(np.nansum(left**2)) / self.noise**2
        return squares + float(values @ information @ values)

    def normal(self, count: int) -> tuple[Array, Array, float]:
        motion = self.motion
        rotors = len(motion.masses)
        size = self.geometry + 4 * rotors
        matrix, vector, squares = np.zeros((size, size)), np.zeros(size), 0.0
        own = np.arange(rotors)
        rows, left = [], []

        def flush() -> None:
            nonlocal squares
            j, e = np.concatenate(rows), np.concatenate(left)
            seen = np.isfinite(e)
            if not seen.all():
                j, e = j[seen], e[seen]
            matrix.__iadd__(j.T @ j)
            vector.__iadd__(j.T @ e)
            squares += float(e @ e)
            rows.clear()
            left.clear()

        for frame, (angles, x) in enumerate(frames_with_changes(motion, self.times[:count])):
            x = x.copy()
            x[own, OF_A_ROTOR * own + 1] += 1
            rows.append(x)
            left.append(self.readings[frame] - motion.lengths.offsets - angles)
            if len(rows) == _TOGETHER:
                flush()
        if rows:
            flush()
        return matrix / self.noise**2, vector / self.noise**2, squares

    def improve(self, count: int, steps: int, settled: float) -> float:
        damping = 0.0
        for step in range(steps):
            matrix, vector, squares = self.normal(count)
            information, values = self.prior(self.motion)
            gradient = self.basis.T @ (vector - information @ values)
            full = self.basis.T @ (matrix + information) @ self.basis
            before = squares / self.noise**2 + float(values @ information @ values)
            for _ in range(8):
                damped = full + damping * np.diag(np.diag(full))
                move = np.linalg.solve(damped, gradient)
                changed = self.motion.changed(self.basis @ move)
                with np.errstate(all='ignore'):
                    after = self.cost(changed, count)
                if after < before + 1e-3:
                    break
                damping = max(4 * damping, 1e-4)
            else:
                return squares
            self.motion = changed
            damping /= 8
            if damping < 1e-6:
                damping = 0.0
            gain = before - after
            seen = int(np.isfinite(self.readings[:count]).sum())
            self.report(f'{count} frames, step {step}: noise {math.sqrt(squares / seen):.5f}, gain {gain:.3g}, damping {damping:.1g}')
            if gain < settled:
                break
        return squares

    def fit(self) -> MotionFit:
        count = min(_FIRST, len(self.times))
        while count < len(self.times):
            self.improve(count, 4, 10.0)
            count = min(math.ceil(_GROWTH * count), len(self.times))
        for _ in range(4):
            self.improve(count, _MOST_STEPS, 0.01 * 10)
            matrix, _, squares = self.normal(count)
            information, values = self.prior(self.motion)
            covariance = self.basis @ np.linalg.inv(self.basis.T @ (matrix + information) @ self.basis) @ self.basis.T
            free = np.isfinite(self.readings).sum() - np.sum(covariance * matrix)
            self.noise = math.sqrt(squares / free)
            g, rotors = self.geometry, len(self.motion.masses)
            before = self.tolerances, self.of_forces
            self.tolerances = self.tolerances.relearnt(self.motion.lengths, covariance[:g, :g])
            diag = np.diag(covariance)
            k, m = np.log(self.motion.stiffnesses), np.log(self.motion.masses)
            s = np.sum((k - k.mean()) ** 2) + np.sum(m**2) + diag[g : g + 2 * rotors - 1].sum()
            self.of_forces = float(np.clip(math.sqrt(s / (2 * rotors - 3)), 1e-3, 0.3))
            self.report(f'noise {self.noise:.5f} {self.tolerances} forces {self.of_forces:.4f}')
            if self.tolerances.close_to(before[0], 0.02) and abs(self.of_forces - before[1]) < 0.02 * before[1]:
                break
        angles = np.array(list(frames(self.motion, self.times)))
        left = self.readings - self.motion.lengths.offsets - angles
        return MotionFit(self.motion, covariance, self.noise, left, self.tolerances, self.of_forces)
