"""Inertial forces and gravity of the bodies: ten parameters, in the link rows of the joints below (eqs. 8, 14-31).

The rows are the virtual power of a body's inertial wrench on the unit motion of each joint below it, which
equals Lagrange's equations of eq. (1) without the rotor terms.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from elid_cli.model.kinematics import Body, Vector, acceleration_field, add, cross, dot, scale
from elid_cli.model.terms.base_term import ChainMotion, Entry
from elid_cli.model.towards_base import Wrench
from elid_cli.model.tracing import Scalar
from elid_cli.robot.parameter import LINK_PARAMETERS, StandardParameter
from elid_cli.robot.robot import Robot


class RigidBody:
    """Mass, first moment and inertia tensor of body i about frame i's origin."""

    name = "rigid_body"
    equation = "tau_j = v_j·f + w_j·n,  f = m a + alpha×c + omega×(omega×c),  n = c×a + I alpha + omega×(I omega)"

    def entries(self, robot: Robot, motion: ChainMotion) -> Iterator[Entry]:
        """Yield the coefficients of m, c and I of every body in the link rows of the joints that carry it."""
        for i in range(1, robot.n + 1):
            body = motion.bodies[i]
            a, omega, alpha = body.acceleration, body.omega, body.alpha
            field = acceleration_field(omega, alpha)
            moments = _moments(omega, alpha)
            names = [StandardParameter(kind, i - 1) for kind in LINK_PARAMETERS]
            for j, (v, w) in body.twists:
                yield Entry("link", j, names[0], dot(v, a))
                lever = cross(a, w)
                for axis in range(3):
                    value = v[0] * field[0][axis] + v[1] * field[1][axis] + v[2] * field[2][axis] + lever[axis]
                    yield Entry("link", j, names[1 + axis], value)
                for name, moment in zip(names[4:], moments, strict=True):
                    yield Entry("link", j, name, dot(w, moment))


def wrench_of(body: Body, ten: Sequence[Scalar]) -> Wrench:
    """Return what moves a body of such parameters, in the order of `LINK_PARAMETERS`, at its frame's origin."""
    mass, x, y, z, *inertia = ten
    a, first = body.acceleration, (x, y, z)
    field = acceleration_field(body.omega, body.alpha)
    fx, fy, fz = (own * mass + dot(row, first) for own, row in zip(a, field, strict=True))
    moment = cross(first, a)
    for value, part in zip(inertia, _moments(body.omega, body.alpha), strict=True):
        if value:
            moment = add(moment, scale(part, value))
    return Wrench((fx, fy, fz), moment)


def _moments(omega: Vector, alpha: Vector) -> tuple[Vector, ...]:
    """Return E alpha + omega x E omega for the unit symmetric matrix E of each inertia.

    Written with the elements of the acceleration field, which the trace computes once for both.
    """
    xx, yy, zz = omega[0] * omega[0], omega[1] * omega[1], omega[2] * omega[2]
    xy, xz, yz = omega[0] * omega[1], omega[0] * omega[2], omega[1] * omega[2]
    x, y, z = alpha
    return (
        (x, xz, -xy),
        (-yz, y, xy),
        (yz, -xz, z),
        (-(xz - y), yz + x, xx - yy),
        (xy + z, zz - xx, -(yz - x)),
        (yy - zz, -(xy - z), xz + y),
    )
