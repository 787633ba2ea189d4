"""A gel by finite elements: axisymmetric, finite strain, neo-Hookean, pressed by a rigid body without friction.

The reference for `palpate.touch.gel`, with which it shares no code. Quadratic quadrilaterals of eight nodes with 2 x 2
points, which bear a Poisson's ratio near 0.5. Contact is a penalty at three points of each edge of the face.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

# Nodes of the reference square: corners, then the middles of the edges.
NODES = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0)], dtype=float)
# Shear moduli a millimetre: of the steps, and at the end, where the body is in the gel by 2 um at most (16 um before).
PENALTIES = 300.0, 3000.0
STEPS, NEWTON, SETTLED = 16, 60, 1e-8


class Pressed(NamedTuple):
    """The face after pressing, nodes by rising radius."""

    radius: np.ndarray  # (n,) m, of the undeformed nodes
    sideways: np.ndarray  # (n,) m, outwards
    indentation: np.ndarray  # (n,) m, into the gel
    force: float  # N


def ball(radius: float) -> Callable:
    """Height (m) of a ball above its lowest point at radii (...), and its derivative."""

    def profile(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r = np.minimum(r, 0.99 * radius)
        rest = np.sqrt(radius**2 - r**2)
        return radius - rest, r / rest

    return profile


def punch(radius: float, fillet: float) -> Callable:
    """As `ball`, of a flat punch whose rim is rounded; beyond it a steep cone."""

    def profile(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        over = np.clip(r - radius + fillet, 0, 0.99 * fillet)
        rest = np.sqrt(fillet**2 - over**2)
        slope = over / rest
        return fillet - rest + slope * np.maximum(r - radius + 0.01 * fillet, 0), slope

    return profile


class Gel:
    """A disc of gel on a rigid base, its mesh finest under the middle of its face."""

    def __init__(self, thickness: float, modulus: float, poisson: float, fine: float, columns=64, rows=12, width=5.0):
        """Metres and Pa. fine: radius with half of the columns. width: radius of the disc, in thicknesses."""
        self.modulus, self.lame = modulus, 2 * modulus * poisson / (1 - 2 * poisson)
        half = columns // 2
        outer = fine + (width * thickness - fine) * np.linspace(0, 1, columns - half + 1)[1:] ** 2
        r, z = np.concatenate([np.linspace(0, fine, half + 1), outer]), thickness * np.linspace(0, 1, rows + 1) ** 0.8
        number = -np.ones((2 * columns + 1, 2 * rows + 1), dtype=int)
        kept = ~(np.arange(2 * columns + 1)[:, None] % 2 & np.arange(2 * rows + 1) % 2).astype(bool)
        number[kept] = np.arange(kept.sum())
        full = [np.interp(np.arange(2 * len(x) - 1) / 2, np.arange(len(x)), x) for x in (r, z)]
        self.nodes = np.stack(np.meshgrid(*full, indexing="ij"), axis=-1)[kept]
        corner = 2 * np.stack(np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"), axis=-1).reshape(
            -1, 1, 2
        )
        at = corner + (NODES + 1).astype(int)
        self.elements = number[at[..., 0], at[..., 1]]
        self.face = number[:, -1].reshape(-1)
        self.edges = np.stack([self.face[0:-1:2], self.face[1::2], self.face[2::2]], axis=1)
        free = np.ones((len(self.nodes), 2), dtype=bool)
        free[number[:, 0]] = False  # bonded to the base
        free[self.nodes[:, 0] == 0, 0] = False  # the axis
        self.free = free.ravel()
        self._prepare()

    def _prepare(self) -> None:
        """Gradients at the points of all elements: B (e, p, 5, 16) from nodes to F_rr, F_rz, F_zr, F_zz, F_tt."""
        x = self.nodes[self.elements]
        points = np.array([(a, b) for a in (-1, 1) for b in (-1, 1)]) / np.sqrt(3)
        shape, slope = zip(*(_shapes(*point) for point in points), strict=True)
        jacobian = np.einsum("pnk,enc->epck", np.array(slope), x)
        gradient = np.einsum("pnk,epkc->epnc", np.array(slope), np.linalg.inv(jacobian))
        radius = np.einsum("pn,en->ep", np.array(shape), x[..., 0])
        self.weight = 2 * np.pi * radius * np.linalg.det(jacobian)
        self.B = np.zeros((*radius.shape, 5, 16))
        for row, (component, axis) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            self.B[:, :, row, component::2] = gradient[..., axis]
        self.B[:, :, 4, 0::2] = np.array(shape) / radius[..., None]
        self.dofs = (2 * self.elements[..., None] + [0, 1]).reshape(-1, 16)

    def _stress(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual forces (d,) and stiffness (d, d) of the gel: P = G (F - F^-T) + lambda ln J F^-T."""
        F = np.einsum("epij,ej->epi", self.B, u[self.dofs]) + [1, 0, 0, 1, 1]
        plane = F[..., 0] * F[..., 3] - F[..., 1] * F[..., 2]
        inverse = (
            np.stack([F[..., 3], -F[..., 2], -F[..., 1], F[..., 0], plane / F[..., 4]], axis=-1) / plane[..., None]
        )
        pressure = self.lame * np.log(plane * F[..., 4]) - self.modulus  # inverse is F^-T, in the order of F
        P = self.modulus * F + pressure[..., None] * inverse
        A = self.modulus * np.eye(5) + self.lame * inverse[..., :, None] * inverse[..., None, :]
        # d(F^-T) = -F^-T dF^T F^-T: of components (i, j) by (k, l) that is -F^-T_il F^-T_kj.
        index = [(0, 0), (0, 1), (1, 0), (1, 1)]
        two = inverse[..., :4].reshape(*inverse.shape[:2], 2, 2)
        for a, (i, j) in enumerate(index):
            for b, (k, m) in enumerate(index):
                A[..., a, b] -= pressure * two[..., i, m] * two[..., k, j]
        A[..., 4, 4] -= pressure * inverse[..., 4] ** 2
        force = np.einsum("epij,epi,ep->ej", self.B, P, self.weight)
        stiffness = np.einsum("epia,epij,epjb,ep->eab", self.B, A, self.B, self.weight, optimize=True)
        residual = np.zeros(len(u))
        np.add.at(residual, self.dofs, force)
        return residual, stiffness

    def press(self, profile: Callable, depth: float) -> Pressed:
        """Press a body into the gel by `depth` m. profile: height above its lowest point and slope at radii."""
        u = np.zeros(2 * len(self.nodes))
        height = self.nodes[self.face[0], 1]
        steps = [(step, PENALTIES[0]) for step in np.linspace(0, depth, STEPS + 1)[1:]] + [(depth, PENALTIES[1])]
        for step, penalty in steps:
            for _ in range(NEWTON):
                residual, stiffness = self._stress(u)
                force, contact, dofs = self._contact(u, profile, height - step, penalty)
                residual += force
                change = np.zeros_like(u)
                parts = [(self.dofs, stiffness), (dofs, contact)]
                rows = np.concatenate([np.repeat(d, d.shape[1], axis=1).ravel() for d, _ in parts])
                columns = np.concatenate([np.tile(d, (1, d.shape[1])).ravel() for d, _ in parts])
                values = np.concatenate([k.ravel() for _, k in parts])
                matrix = coo_matrix((values, (rows, columns)), shape=(len(u), len(u))).tocsr()[self.free][:, self.free]
                change[self.free] = -spsolve(matrix.tocsc(), residual[self.free])
                change *= min(1, 0.1 * height / np.abs(change).max())
                u += change
                if np.abs(change).max() < SETTLED * height:
                    break
            else:
                raise ArithmeticError(f"finite elements did not settle at {step:g} m")
        force, _, _ = self._contact(u, profile, height - depth, penalty)
        moved = u.reshape(-1, 2)[self.face]
        return Pressed(self.nodes[self.face, 0], moved[:, 0], -moved[:, 1], float(force[1::2].sum()))

    def _contact(self, u, profile: Callable, lowest: float, penalty: float) -> tuple[np.ndarray, ...]:
        """Forces (d,), stiffness (edges, 6, 6) and its unknowns (edges, 6) of the penalty k gap^2 / 2 on the face."""
        penalty *= 1e3 * self.modulus
        x = self.nodes[self.edges]
        place = x + u.reshape(-1, 2)[self.edges]
        dofs = (2 * self.edges[..., None] + [0, 1]).reshape(-1, 6)
        force, stiffness = np.zeros((len(dofs), 6)), np.zeros((len(dofs), 6, 6))
        for at, weight in zip((-np.sqrt(0.6), 0, np.sqrt(0.6)), (5 / 9, 8 / 9, 5 / 9), strict=True):
            shape = np.array([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2])
            length = (x[:, 2, 0] - x[:, 0, 0]) / 2
            area = 2 * np.pi * (shape @ x[..., 0].T) * length * weight
            r, z = shape @ place[..., 0].T, shape @ place[..., 1].T
            height, slope = profile(np.abs(r))
            gap = np.minimum(lowest + height - z, 0)
            gradient = np.zeros((len(dofs), 6))
            gradient[:, 0::2], gradient[:, 1::2] = slope[:, None] * shape, -shape
            force += (penalty * area * gap)[:, None] * gradient
            touching = penalty * area * (gap < 0)
            stiffness += touching[:, None, None] * gradient[:, :, None] * gradient[:, None, :]
        residual = np.zeros(len(u))
        np.add.at(residual, dofs, force)
        return residual, stiffness, dofs


def _shapes(a: float, b: float) -> tuple[np.ndarray, np.ndarray]:
    """The eight shape functions (8,) at a point of the reference square, and their gradients (8, 2)."""
    shape, slope = np.zeros(8), np.zeros((8, 2))
    for number, (p, q) in enumerate(NODES):
        if p and q:
            shape[number] = (1 + p * a) * (1 + q * b) * (p * a + q * b - 1) / 4
            slope[number] = p * (1 + q * b) * (2 * p * a + q * b) / 4, q * (1 + p * a) * (2 * q * b + p * a) / 4
        elif q:
            shape[number], slope[number] = (1 - a**2) * (1 + q * b) / 2, (-a * (1 + q * b), q * (1 - a**2) / 2)
        else:
            shape[number], slope[number] = (1 - b**2) * (1 + p * a) / 2, (p * (1 - b**2) / 2, -b * (1 + p * a))
    return shape, slope
