"""Joints of a user's model that move together: which drives which, and where it puts them.

Equalities of joints (a URDF's mimic joints among them), closed loops (`connect`, `weld`) and fixed tendons with an
actuator make one mechanism of several joints, which gets one servo. Where its driver puts the others is solved from the
model's own constraints; polynomials are fitted to that, of the degree of MuJoCo's equalities of joints.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from scipy.optimize import least_squares
from scipy.sparse.csgraph import connected_components

SAMPLES = 41  # of a driver's range
TOLERANCE = 5e-4  # rad, of slides and loops m, by which couplings may be off: fingers stop as deep in a contact
# Weights beside the constraints: what these leave free is decided by the joints' springs, or their reference.
SPRING, REFERENCE = 1e-3, 1e-5
EXACT = 1e-7  # of a fit: no higher degree is tried
REMEDY = "write it as `equality/joint`s of one driver with `polycoef`, or delete it"


class Couplings:
    """Of the J joints with these numbers: `driver` (J,), `coefficients` (J, 5) of powers of the driver's position, and
    `range` (J, 2), NaN without one.

    Raises ValueError that names the equality, or the joints, for what ties the hand to something else, or is not moved
    by one servo within `TOLERANCE`.
    """

    def __init__(self, model: mujoco.MjModel, joints: list[int]):
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model, self.data, self.joints = model, mujoco.MjData(model), np.array(joints, dtype=int)
        self.positions, self.dofs = model.jnt_qposadr[self.joints], model.jnt_dofadr[self.joints]
        self.reference, count = model.qpos0[self.positions], len(joints)
        self.driver, self.coefficients = np.arange(count), np.tile(np.eye(5)[1], (count, 1))
        self.range = np.where(model.jnt_limited[self.joints, None], model.jnt_range[self.joints], np.nan)
        self.follows, self.named = np.zeros(count, dtype=bool), {}  # joints that equalities of joints move; names
        self.actuated = [*self._actuated()]
        self.tendons = np.zeros((0, count))  # rows that are 0 for joint positions less their reference
        ties, together = dict(self._equalities()), np.eye(count, dtype=bool)
        for members in ties.values():
            together[np.ix_(members, members)] = True
        for (first, *others), (coefficient, *coefficients) in self.actuated:
            for joint, other in zip(others, coefficients, strict=True):
                mechanism = connected_components(together)[1]
                if mechanism[joint] != mechanism[first]:  # else equalities say how they move together
                    row = np.eye(count)[joint] / other - np.eye(count)[first] / coefficient
                    self.tendons = np.vstack([self.tendons, row])
                    together[first, joint] = True
        mechanism = connected_components(together)[1]
        for number in np.flatnonzero(np.bincount(mechanism) > 1):
            members = np.flatnonzero(mechanism == number)
            self.kept = [equality for equality, tied in ties.items() if np.isin(tied, members).any()]
            self.rows = self.tendons[self.tendons[:, members].any(axis=1)]
            self._couple(members)

    def _actuated(self) -> Iterator[tuple[list[int], np.ndarray]]:
        """The joints of the hand that each actuator moves, by itself or by a fixed tendon, and their coefficients."""
        model, of_joint = self.model, {joint: number for number, joint in enumerate(self.joints)}
        for kind, target in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True):
            moved, coefficients = [target], np.ones(1)
            if kind == mujoco.mjtTrn.mjTRN_TENDON:
                wraps = slice(model.tendon_adr[target], model.tendon_adr[target] + model.tendon_num[target])
                fixed = (model.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_JOINT).all()
                moved, coefficients = (model.wrap_objid[wraps] if fixed else []), model.wrap_prm[wraps]
            elif kind != mujoco.mjtTrn.mjTRN_JOINT:
                continue
            if len(moved) and all(joint in of_joint for joint in moved):
                yield [of_joint[joint] for joint in moved], coefficients

    def _equalities(self) -> Iterator[tuple[int, np.ndarray]]:
        """Numbers of the active equalities, and the joints that each ties together."""
        aside = 0.01 * np.random.default_rng(0).normal(size=len(self.joints))  # of the reference: slopes may be 0 there
        _, jacobian = self._equality_rows(self.reference + aside)
        equality = self.data.efc_id[: len(jacobian)]
        for number in np.unique(equality):
            kind = mujoco.mjtEq(self.model.eq_type[number]).name.removeprefix("mjEQ_").lower()
            self.named[number] = what = f"equality/{kind} {self.model.eq(number).name or number}"
            moved = np.abs(jacobian[equality == number]).max(axis=0) > 1e-9
            members = np.flatnonzero(moved[self.dofs])
            moved[self.dofs] = False
            if len(members) and moved.any():
                raise ValueError(f"{what} ties the hand to what is not below its palm: delete it, or name another palm")
            if len(members) == 1:
                raise ValueError(f"{what} fixes joint {self._names(members)}: delete both")
            if kind == "joint":
                self.follows |= self.joints == self.model.eq_obj1id[number]
            yield number, members

    def _equality_rows(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By how much the equalities are violated at joint positions (J,): (R,) rad or m, and derivatives (R, nv)."""
        model, data = self.model, self.data
        data.qpos[:], data.qpos[self.positions] = model.qpos0, positions
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_makeConstraint):
            compute(model, data)
        equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY  # they come first
        return data.efc_pos[equality], data.efc_J.reshape(len(equality), model.nv)[equality]

    def _couple(self, members: np.ndarray) -> None:
        """Let one of the joints drive the others: one that has an actuator, if it can be chosen."""
        first = [joint for joint in members if not self.follows[joint]] or members
        driver = next((joint for moved, _ in self.actuated for joint in moved if joint in first), first[0])
        others = members[members != driver]
        ties = [self.named[number] for number in self.kept] + ["an actuated tendon"] * bool(len(self.rows))
        what = f"{' with '.join(ties)}, of joints {self._names(members)},"
        if np.isnan(self.range[driver]).any():
            raise ValueError(f"joint {self._names([driver])} has no range: give it one")
        slopes = self._violated(driver, others, self.reference[driver], self.reference[others])[1]
        actuators = sum(np.isin(moved, members).any() for moved, _ in self.actuated)
        if actuators > 1 and np.linalg.matrix_rank(slopes, 1e-6) < len(others):
            raise ValueError(f"{what} needs the servos of {actuators} actuators, and gets one: {REMEDY}")
        grid, solved = np.linspace(*self.range[driver], SAMPLES), np.zeros((SAMPLES, len(others)))
        start = int(np.abs(grid - self.reference[driver]).argmin())
        for number in [*range(start, SAMPLES), *range(start)[::-1]]:
            before = number + 1 if number < start else max(number - 1, start)  # its neighbour towards the reference
            guess = self.reference[others] if number == start else solved[before]
            solved[number] = self._solve(driver, others, grid[number], guess)
        off = self._off(driver, others, grid, solved)
        wrong = np.flatnonzero(off > TOLERANCE)
        low, high = np.append(wrong[wrong < start], -1).max() + 1, np.append(wrong[wrong > start], SAMPLES).min()
        if off[start] > TOLERANCE or high - low < 2:
            raise ValueError(
                f"{what} can't be kept while {self._names([driver])} moves from its reference, within all ranges:"
                f" off by up to {off.max():.2g} rad or m; {REMEDY}"
            )
        grid, solved = grid[low:high], solved[low:high]
        for degree in range(1, 5):
            fit = np.round(polyfit(grid, solved, degree), 9) + 0.0  # no -0
            followed = polyval(grid, fit).T
            off = self._off(driver, others, grid, followed).max()
            if off < EXACT:
                break
        if off > TOLERANCE:
            raise ValueError(f"{what} is no quartic function of its driver: off by {off:.2g} rad or m; {REMEDY}")
        self.coefficients[others], self.coefficients[others, : degree + 1] = 0, fit.T
        self.driver[others], self.range[driver] = driver, grid[[0, -1]]
        self.range[others] = np.stack([followed.min(axis=0), followed.max(axis=0)], axis=1)

    def _solve(self, driver: int, others: np.ndarray, position: float, guess: np.ndarray) -> np.ndarray:
        """Positions of the joints that a driver at a position leaves, by Newton's method from a guess."""
        model, joints = self.model, self.joints[others]
        stiffness = model.jnt_stiffness.reshape(model.njnt, -1)[joints, 0]
        weight = np.where(stiffness > 0, SPRING * np.sqrt(stiffness), REFERENCE)
        rest = np.where(stiffness > 0, model.qpos_spring[self.positions[others]], self.reference[others])
        low, high = np.where(np.isnan(self.range[others]), [-np.inf, np.inf], self.range[others]).T

        def residual(values: np.ndarray) -> np.ndarray:
            return np.append(self._violated(driver, others, position, values)[0], weight * (values - rest))

        def jacobian(values: np.ndarray) -> np.ndarray:
            return np.vstack([self._violated(driver, others, position, values)[1], np.diag(weight)])

        settings = {"method": "dogbox", "xtol": 1e-12, "ftol": None, "gtol": None, "max_nfev": 40}
        found = least_squares(residual, np.clip(guess, low, high), jacobian, (low, high), **settings).x
        violated, slopes = self._violated(driver, others, position, found)  # what the weights have left of it
        return np.clip(found - np.linalg.lstsq(slopes, violated, rcond=1e-6)[0], low, high)

    def _off(self, driver: int, others: np.ndarray, *positions: np.ndarray) -> np.ndarray:
        rows = zip(*positions, strict=True)
        return np.array([np.abs(self._violated(driver, others, *row)[0]).max() for row in rows])

    def _violated(self, driver, others, position, values) -> tuple[np.ndarray, np.ndarray]:
        """`_equality_rows` and tendons with these joints at these positions: (R,), and derivatives by the others'."""
        at = self.reference.copy()
        at[driver], at[others] = position, values
        violated, jacobian = self._equality_rows(at)
        kept = np.isin(self.data.efc_id[: len(violated)], self.kept)
        violated = np.append(violated[kept], self.rows @ (at - self.reference))
        return violated, np.vstack([jacobian[kept][:, self.dofs], self.rows])[:, others]

    def _names(self, joints) -> str:
        return ", ".join(repr(self.model.joint(joint).name) for joint in self.joints[joints])
