"""Joints of a user's model that move together: which drives which, and where it puts them. Equalities of joints (a
URDF's mimics, too), closed loops (`connect`, `weld`) and fixed tendons with an actuator make one mechanism, with one
servo. Positions are solved from the model's own constraints; polynomials are fitted to them."""

import mujoco
import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from scipy.optimize import least_squares
from scipy.sparse.csgraph import connected_components

SAMPLES = 41  # of a driver's range
TOLERANCE = 5e-4  # rad, of slides and loops m, by which couplings may be off: fingers stop as deep in a contact
# Weights beside the constraints: what these leave free is decided by the joints' springs, or their reference.
SPRING, REFERENCE = 1e-3, 1e-5
SOLVER = {"method": "dogbox", "xtol": 1e-12, "ftol": None, "gtol": None, "max_nfev": 40}
EXACT = 1e-7  # of a fit: no higher degree is tried
REMEDY = "write it as `equality/joint`s of one driver with `polycoef`, or delete it"


class Couplings:
    """Couplings of the J joints with these numbers: `driver` (J,), `coefficients` (J, 5) of powers of the driver's
    position, and `range` (J, 2), NaN without one. Raises ValueError that names the equality, or the joints, for what
    ties the hand to something else, or is not moved by one servo within `TOLERANCE`."""

    def __init__(self, model: mujoco.MjModel, joints: list[int]):
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model, self.data, self.joints = model, mujoco.MjData(model), np.array(joints, dtype=int)
        self.positions, self.dofs = model.jnt_qposadr[self.joints], model.jnt_dofadr[self.joints]
        self.reference, count = model.qpos0[self.positions], len(joints)
        self.driver, self.coefficients = np.arange(count), np.tile(np.eye(5)[1], (count, 1))
        self.range = np.where(model.jnt_limited[self.joints, None], model.jnt_range[self.joints], np.nan)
        stiffness = model.jnt_stiffness[self.joints]
        self.weight = np.where(stiffness > 0, SPRING * np.sqrt(stiffness), REFERENCE)
        self.rest = np.where(stiffness > 0, model.qpos_spring[self.positions], self.reference)
        self.tendons = np.zeros((0, count))  # rows that are 0 for joint positions less their reference
        equalities, tendons, unit = self._equalities(), [], np.eye(count)
        # Moment arms about the joints, (A, J), of actuators that move them alone, also by a fixed tendon.
        mujoco.mj_forward(model, self.data)
        arms = np.zeros((model.nu, model.nv))
        sparse = (getattr(self.data, f"moment_{name}") for name in ("rownnz", "rowadr", "colind"))
        mujoco.mju_sparse2dense(arms, self.data.actuator_moment, *sparse)
        kind, tendon = model.actuator_trntype, model.actuator_trnid[:, 0]
        fixed = kind == mujoco.mjtTrn.mjTRN_TENDON
        fixed[fixed] = model.wrap_type[model.tendon_adr[tendon[fixed]]] == mujoco.mjtWrap.mjWRAP_JOINT
        alone = ~np.delete(arms, self.dofs, axis=1).any(axis=1) & arms.any(axis=1)
        moments = arms[alone & (fixed | (kind == mujoco.mjtTrn.mjTRN_JOINT))][:, self.dofs]
        mechanism = connected_components(equalities.T.astype(int) @ equalities)[1]
        for row in moments:
            first, *others = np.flatnonzero(row)
            for joint in others:
                if mechanism[joint] != mechanism[first]:  # else equalities say how they move together
                    tendons.append(unit[joint] / row[joint] - unit[first] / row[first])
                    mechanism[mechanism == mechanism[joint]] = mechanism[first]
        for number in np.flatnonzero(np.bincount(mechanism) > 1):
            members = np.flatnonzero(mechanism == number)
            self.data.eq_active[:] = equalities[:, members].any(axis=1)
            self.tendons = np.reshape([row for row in tendons if row[members].any()], (-1, count))
            self._couple(members, moments[moments[:, members].any(axis=1)])

    def _equalities(self) -> np.ndarray:
        """Which joints each equality ties together, (E, J) bool; none if it is not active."""
        aside = 0.01 * np.random.default_rng(0).normal(size=len(self.joints))  # of the reference: slopes may be 0 there
        self._violated(self.reference + aside)
        model, data = self.model, self.data
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        moved = np.zeros((model.neq, model.nv), dtype=bool)
        np.logical_or.at(moved, data.efc_id[rows], np.abs(data.efc_J.reshape(len(rows), model.nv)[rows]) > 1e-9)
        tied = moved[:, self.dofs]
        for number in np.flatnonzero(tied.any(axis=1)):
            what, members = self._equality(number), np.flatnonzero(tied[number])
            if moved[number].sum() > len(members):
                raise ValueError(f"{what} ties the hand to what is not below its palm: delete it, or name another palm")
            if len(members) == 1:
                raise ValueError(f"{what} fixes joint {self._names(members)}: delete both")
        return tied

    def _violated(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Violations (R,) of active equalities and `tendons` at (J,), rad or m, and their derivatives (R, J)."""
        model, data = self.model, self.data
        data.qpos[:], data.qpos[self.positions] = model.qpos0, at
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_makeConstraint):
            compute(model, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        slopes = data.efc_J.reshape(len(rows), model.nv)[rows][:, self.dofs]
        violated = np.append(data.efc_pos[rows], self.tendons @ (at - self.reference))
        return violated, np.vstack([slopes, self.tendons])

    def _couple(self, members: np.ndarray, moments: np.ndarray) -> None:
        """Let one of the joints drive the others: one that follows no other by an equality and has an actuator, if any;
        moments: of the actuators that move them."""
        active = self.data.eq_active.astype(bool)
        follows = np.isin(self.joints, self.model.eq_obj1id[active & (self.model.eq_type == mujoco.mjtEq.mjEQ_JOINT)])
        driver = min(members, key=lambda joint: (follows[joint], not moments[:, joint].any()))
        others = members[members != driver]
        ties = [self._equality(number) for number in np.flatnonzero(active)]
        ties += ["an actuated tendon"] * bool(len(self.tendons))
        what = f"{' with '.join(ties)}, of joints {self._names(members)},"
        if np.isnan(self.range[driver]).any():
            raise ValueError(f"joint {self._names([driver])} has no range: give it one")
        slopes = self._violated(self.reference)[1][:, others]
        if len(moments) > 1 and np.linalg.matrix_rank(slopes, 1e-6) < len(others):
            raise ValueError(f"{what} needs the servos of {len(moments)} actuators, and gets one: {REMEDY}")
        low, high = self.range[driver]
        grid = np.linspace(low, high, SAMPLES)
        start, solved = int(np.abs(grid - self.reference[driver]).argmin()), np.zeros((SAMPLES, len(self.joints)))
        for numbers in (range(start, SAMPLES), range(start, -1, -1)):
            at = self.reference.copy()
            for number in numbers:
                at[driver] = grid[number]
                at[others] = self._solve(others, at)
                solved[number] = at
        off = self._off(solved)
        beyond = np.cumsum(off > TOLERANCE)
        kept = solved[(beyond == beyond[start]) & (off <= TOLERANCE)]
        if off[start] > TOLERANCE or len(kept) < 2:
            raise ValueError(
                f"{what} can't be kept while {self._names([driver])} moves from its reference, within all ranges:"
                f" off by up to {off.max():.2g} rad or m; {REMEDY}"
            )
        for degree in range(1, 5):
            fit = np.round(polyfit(kept[:, driver], kept[:, others], degree), 9) + 0.0  # no -0
            followed = kept.copy()
            followed[:, others] = polyval(kept[:, driver], fit).T
            off = self._off(followed)
            if off.max() < EXACT:
                break
        if off.max() > TOLERANCE:
            raise ValueError(f"{what} is no quartic function of its driver: off by {off.max():.2g} rad or m; {REMEDY}")
        self.coefficients[others], self.coefficients[others, : degree + 1] = 0, fit.T
        self.driver[others] = driver
        self.range[members] = np.stack([followed.min(axis=0), followed.max(axis=0)], axis=1)[members]

    def _solve(self, others: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Positions of the joints that a driver leaves, with the J joints at `at`, which is a guess of the others'."""
        low, high = np.where(np.isnan(self.range[others]), [-np.inf, np.inf], self.range[others]).T
        weight, rest, at = self.weight[others], self.rest[others], at.copy()

        def constraints(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            at[others] = values
            violated, slopes = self._violated(at)
            return violated, slopes[:, others]

        solution = least_squares(
            lambda values: np.append(constraints(values)[0], weight * (values - rest)),
            np.clip(at[others], low, high),
            lambda values: np.vstack([constraints(values)[1], np.diag(weight)]),
            (low, high),
            **SOLVER,
        ).x
        violated, slopes = constraints(solution)  # what the weights have left of it
        return np.clip(solution - np.linalg.lstsq(slopes, violated, rcond=1e-6)[0], low, high)

    def _off(self, positions: np.ndarray) -> np.ndarray:
        """Largest violation at each row of joint positions (N, J): (N,) rad or m."""
        return np.array([np.abs(self._violated(at)[0]).max() for at in positions])

    def _equality(self, number: int) -> str:
        """An equality as messages call it: its kind, and its name or number."""
        kind = mujoco.mjtEq(self.model.eq_type[number]).name.removeprefix("mjEQ_").lower()
        return f"equality/{kind} {self.model.eq(number).name or number}"

    def _names(self, joints: np.ndarray | list[int]) -> str:
        """Names of some of the joints, by their numbers among the hand's."""
        return ", ".join(repr(self.model.joint(joint).name) for joint in self.joints[joints])
