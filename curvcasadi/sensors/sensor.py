"""What a kind of sensor is: where it sits, what it reads at its station, and the derivatives of it.

A sensor sits at the station `xi`, at `offset` from the reference curve in local axes, and its own
axes are turned by `mounting`, which takes sensor components to local ones. Noise is white, and
independent between samples, axes and sensors. `offset`, `mounting`, `pose` and `bias` may be
symbols; `bias` adds to what an ideal sensor reads.

All in the inertial axes that coincide with the root's at this instant ("root axes" below), where a
station moves as `kinematics.state.StationMotion` says. With the spatial Jacobian J = (A, B), its
rates (A_t, B_t), (A_tt, B_tt), and a material point P = p + R r:

    R_q = [A×] R,    P_q = B + A × P,    (Rᵀ Ω)_q = Rᵀ A_t,    (Rᵀ Ω)_q_dot = Rᵀ A
    P_tt,q = (P_q)_tt,    P_tt,q_dot = 2 (P_q)_t,    P_tt,q_ddot = P_q

The attitude of the parent is varied on the right, C exp(φ), φ in parent axes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from curvcasadi.beam.pose import Pose, checked_pose
from curvcasadi.kinematics.state import StationMotion
from curvcasadi.lie import so3
from curvcasadi.sensors.frames import Frames, Mount
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    choice,
    expression,
    function_name,
    numbers,
    own_fields,
    positive,
    rotation_matrix,
    station,
)

XYZ = ("x", "y", "z")
#: Shapes at which a sensor of curvature may read zero.
REFERENCES = ("unloaded", "straight")


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor:
    """What all kinds of sensors have in common. A kind of the user's inherits from this class.

    A kind is a frozen, keyword-only dataclass with a field `noise`, the standard deviation of one
    sample of each residual. It says what it reads by the class method `value`; the derivatives of
    that are found by `slopes`, and further class methods say what else is special about it. They
    take the station as `StationMotion`, the parent and root as `Frames`, and the sensor's own
    fields as a `Mount`, all SX: one CasADi Function serves all sensors of a kind.

    Attributes
    ----------
    xi : float
        Station s/L.
    name : str or None
        Begins its labels; None for "gyro_1" and so on.
    prefix : str
        Of the names of unnamed sensors.
    components : tuple of str
        Of the value; ("",) of a scalar.
    unit, residual_unit : str
        Of the value, and of prediction against measurement.
    residual_components : tuple of str
        Of prediction against measurement.
    order : int
        0: reads the shape, 1: and its rate, 2: and its acceleration.
    shapes : dict of str to tuple of int
        Fields that the reading depends on, and that may be symbols, with their shapes; beside
        `bias`, whose shape is that of the residual.
    world : str or None
        The field of `RootMotion` that it reads, "gravity" or "magnetic_field".
    whole : bool
        Whether a sample is there as a whole or not at all.
    stand_in : tuple of float
        The value in place of a sample that is missing; zeros where empty.
    may_be_hidden : bool
        Whether there may be no reading, as `in_view` says; it is NaN then.
    """

    xi: float
    name: str | None = None

    prefix: ClassVar[str] = "sensor"
    components: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = ""
    residual_components: ClassVar[tuple[str, ...]] = ()
    residual_unit: ClassVar[str] = ""
    order: ClassVar[int] = 0
    shapes: ClassVar[dict[str, tuple[int, int]]] = {
        "offset": (3, 1),
        "mounting": (3, 3),
        "pose": (3, 4),
    }
    world: ClassVar[str | None] = None
    whole: ClassVar[bool] = False
    stand_in: ClassVar[tuple[float, ...]] = ()
    may_be_hidden: ClassVar[bool] = False

    def __post_init__(self) -> None:
        own_fields(self)
        size = len(self.residual_components)
        for entry in fields(self):
            where = f"{type(self).__name__}.{entry.name}"
            value = self._checked(entry.name, where, getattr(self, entry.name), size)
            object.__setattr__(self, entry.name, value)

    def _checked(self, field_name: str, where: str, value: Any, size: int) -> Any:
        """The value of a field, or a ValueError that names it."""
        match field_name:
            case "xi":
                return station(where, value)
            case "name":
                return value if value is None else function_name(where, value)
            case "mounting":
                return rotation_matrix(where, value)
            case "pose":
                return checked_pose(where, value)
            case "bias":
                return expression(where, np.zeros(size) if value is None else value, (size, 1))
            case "reference":
                return choice(where, value, REFERENCES)
            case "rate":
                return float(positive_numbers(where, value, 1)[0])
            case "noise" | "noise_density":
                return positive_numbers(where, value, size)
        shape = self.shapes.get(field_name)
        return value if shape is None else expression(where, value, shape)

    @classmethod
    def value(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        """What the sensor reads.

        Parameters
        ----------
        at : StationMotion
            Rotation (3, 3) and position (3, 1), m, of the station, and for `order` 1 and 2 its
            spatial twist and acceleration (6, 1), in the inertial axes that coincide with the
            root's; `point` gives position, velocity and acceleration of a point fixed to it.
        frames : Frames
            The parent in inertial axes, and the root in the parent.
        mount : Mount
            `bias`, and the fields in `shapes`.

        Returns
        -------
        SX, shape (m, 1)
            One per component, its bias included.
        """
        raise NotImplementedError(f"{cls.__name__}.value: expected a class method, found none")

    @classmethod
    def slopes(cls, at: StationMotion, frames: Frames, mount: Mount) -> dict[str, Any]:
        """Derivatives of `value` by the name of what is varied.

        By AD of one station and the sums of `at`, unless a kind has its own, as one of order 2
        must. Where value and residual differ in size, as of attitudes, they are those of a
        variation of the value in the size of the residual.

        Parameters
        ----------
        at : StationMotion
            As of `value`.
        frames : Frames
            As of `value`.
        mount : Mount
            As of `value`.

        Returns
        -------
        dict of str to SX, shape (r, columns)
            Of "q", "q_dot" and "q_ddot", n columns each; "attitude" of the parent, varied on the
            right, and its "position", 3 columns; "twist" and "twist_rate" of the root, 6 columns.
            What is not there is zero.
        """
        return _slopes_by_ad(cls, at, frames, mount)

    @classmethod
    def residual(cls, value: Any, measured: Any) -> Any:
        """Prediction minus measurement.

        Parameters
        ----------
        value, measured : SX, MX or DM, shape (m, 1)
            What is predicted, and a sample.

        Returns
        -------
        SX, MX or DM, shape (r, 1)
            In `residual_unit`.
        """
        return value - measured

    @classmethod
    def residual_by_variation(cls, residual: Any) -> Any:
        """Derivative of the residual by the variation that `slopes` describe.

        Parameters
        ----------
        residual : SX, shape (r, 1)
            Where it is taken.

        Returns
        -------
        SX or DM, shape (r, r)
            The identity unless a kind has its own.
        """
        return ca.DM.eye(len(cls.residual_components))

    @classmethod
    def in_view(cls, at: StationMotion, frames: Frames, mount: Mount) -> Any:
        """Whether there is a reading, of kinds that `may_be_hidden`.

        Parameters
        ----------
        at : StationMotion
            As of `value`.
        frames : Frames
            As of `value`.
        mount : Mount
            As of `value`.

        Returns
        -------
        SX or int
            1 if there is one, else 0.
        """
        return 1

    @classmethod
    def present(cls, values: Any) -> Any:
        """1 for each entry of a sample (m, 1) that is there, else 0; of a `whole` one (1, 1).

        A number is below zero or not; NaN is neither, as comparisons with it are false in C, too.

        Parameters
        ----------
        values : SX or DM, shape (m, 1)
            A sample.

        Returns
        -------
        SX or DM, shape (m, 1) or (1, 1)
            Ones and zeros.
        """
        return ca.logic_or(values < 0, values >= 0)

    @classmethod
    def checked_sample(cls, name: str, values: ca.DM) -> ca.DM:
        """A sample as it is used.

        Parameters
        ----------
        name : str
            What an error calls the sample.
        values : DM, shape (m, 1)
            Its numbers.

        Returns
        -------
        DM, shape (m, 1)
            The numbers themselves unless a kind corrects them.

        Raises
        ------
        ValueError
            If they cannot be a sample; the message begins with `name`.
        """
        return values

    def mount(self) -> dict[str, AnyExpr]:
        """Fields that the reading depends on.

        Returns
        -------
        dict of str to SX, MX or DM
            By name; a pose as (R, p), (3, 4).
        """
        found = {key: getattr(self, key) for key in self.mount_shapes()}
        return {
            key: ca.horzcat(value.rotation, value.position) if isinstance(value, Pose) else value
            for key, value in found.items()
        }

    @classmethod
    def mount_shapes(cls) -> dict[str, tuple[int, int]]:
        """Shapes of `mount`, in the order of the fields."""
        shapes = {**cls.shapes, "bias": (len(cls.residual_components), 1)}
        return {entry.name: shapes[entry.name] for entry in fields(cls) if entry.name in shapes}


@dataclass(frozen=True, eq=False, kw_only=True)
class CurvatureSensor(Sensor):
    """What kinds of sensors have in common that read a curvature at their station, linearly.

    It is K − K_0, or K with `reference="straight"`.
    """

    reference: Literal["unloaded", "straight"] = "unloaded"  #: shape at which it reads zero

    bias: Number = None  #: (r,), unit of the value; zero where None

    def factors(self) -> AnyExpr:
        """Reading per curvature, (r, 3); bias is added."""
        raise NotImplementedError(f"{type(self).__name__}.factors: expected a method, found none")


def _slopes_by_ad(
    kind: type[Sensor], at: StationMotion, frames: Frames, mount: Mount
) -> dict[str, Any]:
    """`Sensor.slopes` of orders 0 and 1, with V the spatial twist and J = (A, B):

    R_q = [A×] R,   p_q = B + A × p,   V_q = J_t − ad(V) J,   V_q_dot = J,   V_twist = I
    """
    if kind.order > 1:
        raise NotImplementedError(f"{kind.__name__}.slopes: expected its own, as its order is 2")
    value = kind.value(at, frames, mount)
    (a, b), *rates = at.sums

    def turned(rotation: Any, by: Any) -> Any:
        return ca.vertcat(*(-so3.hat(rotation[:, k]) @ by for k in range(3)))

    by_pose = ca.jacobian(value, ca.veccat(at.rotation, at.position))
    slopes = {"q": by_pose @ ca.vertcat(turned(at.rotation, a), b - so3.hat(at.position) @ a)}
    if kind.order:
        by_twist, omega = ca.jacobian(value, at.twist), so3.hat(at.twist[:3])
        (a_t, b_t), v = rates[0], so3.hat(at.twist[3:])
        slopes["q"] += by_twist @ ca.vertcat(a_t - omega @ a, b_t - v @ a - omega @ b)
        slopes |= {"q_dot": by_twist @ ca.vertcat(a, b), "twist": by_twist}
    # C exp([φ×]): row by row, δ(C rowᵀ) = −φ × C rowᵀ.
    by_attitude = ca.jacobian(value, ca.vec(frames.attitude.T))
    slopes["attitude"] = by_attitude @ turned(frames.attitude.T, -ca.DM.eye(3))
    slopes["position"] = ca.jacobian(value, frames.position)
    return slopes


def positive_numbers(where: str, value: Number, size: int) -> Array:
    """One number above zero for all entries, or one for each: (size,)."""
    array = numbers(where, value).ravel()
    if array.size not in (1, size):
        expected = "1 number" if size == 1 else f"1 number or {size}"
        raise ValueError(f"{where}: expected {expected}, found {array.size}")
    for entry in array:
        positive(where, entry)
    return np.array(np.broadcast_to(array, (size,)))
