r"""Scalar building blocks of the compiled kernels: rotations, and the residual's stiffness.

A loop's residual is ``e = log6(M) = (v, w)`` with :math:`v = V(w)^{-1} t`, its energy
:math:`E = \tfrac12 k_t |v|^2 + \tfrac12 k_r |w|^2`. With :math:`c(x) = (1 - \tfrac\theta2 \cot\tfrac\theta2) / x`,
:math:`x = \theta^2 = |w|^2`, the inverse right Jacobian of SE(3) has the blocks

.. math:: A = I + \tfrac12 \hat w + c\,\hat w^2, \qquad
          B = \tfrac12 \hat v + c\,(\hat w \hat v + \hat v \hat w) + 2 c' (w \cdot v)\,\hat w^2

(B is the derivative of A along v, because ad(e) is block triangular), and ``J^T K e`` is the wrench

.. math:: f = k_t A^T v, \qquad
          \tau = k_r w + k_t [\,c\, v \times (w \times v) + 2 c' (w \cdot v)\, w \times (w \times v)\,].

All of this is isotropic: rotating v and w rotates the result. So the kernels work in base axes.
Rotations are tuples of nine numbers, row by row. Nothing here allocates.
"""

import math

from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.mechanism.arrays import FloatArray

_SERIES_BELOW = 0.25  # of theta^2: the terms left out are below 1e-16 of the sum

# c(x) = sum |B_2n| / (2n)! x^(n-1), with the Bernoulli numbers B_2n.
_B0, _B1, _B2, _B3 = (1.0 / 12.0, 1.0 / 720.0, 1.0 / 30240.0, 1.0 / 1209600.0)
_B4, _B5, _B6, _B7 = (1.0 / 47900160.0, 691.0 / 1307674368000.0, 1.0 / 74724249600.0, 3617.0 / 10670622842880000.0)

Triple = tuple[float, float, float]
Rotation = tuple[float, float, float, float, float, float, float, float, float]


@compiled
def plus(a: Triple, b: Triple) -> Triple:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def minus(a: Triple, b: Triple) -> Triple:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def scaled(s: float, a: Triple) -> Triple:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@compiled
def combined(a: Triple, s: float, b: Triple, t: float, c: Triple) -> Triple:
    """Return a + s b + t c."""
    return a[0] + s * b[0] + t * c[0], a[1] + s * b[1] + t * c[1], a[2] + s * b[2] + t * c[2]


@compiled
def cross(a: Triple, b: Triple) -> Triple:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def dot(a: Triple, b: Triple) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def turn(r: Rotation, a: Triple) -> Triple:
    """Return the rotated vector R a."""
    return (
        r[0] * a[0] + r[1] * a[1] + r[2] * a[2],
        r[3] * a[0] + r[4] * a[1] + r[5] * a[2],
        r[6] * a[0] + r[7] * a[1] + r[8] * a[2],
    )


@compiled
def turn_back(r: Rotation, a: Triple) -> Triple:
    """Return R^T a."""
    return (
        r[0] * a[0] + r[3] * a[1] + r[6] * a[2],
        r[1] * a[0] + r[4] * a[1] + r[7] * a[2],
        r[2] * a[0] + r[5] * a[1] + r[8] * a[2],
    )


@compiled
def transposed(r: Rotation) -> Rotation:
    """Return the axes of a rotation as rows."""
    return r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]


@compiled
def product(a: Rotation, b: Rotation) -> Rotation:
    """Return the rotation A B."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@compiled
def rotation_from_vector(w: Triple) -> Rotation:
    """Return exp3 of a rotation vector in rad: I + sin(t)/t [w] + (1 - cos t)/t^2 [w]^2."""
    x = dot(w, w)
    s, c = 1.0, 0.5
    if x > 0.0:
        angle = math.sqrt(x)
        s, c = math.sin(angle) / angle, 2.0 * math.sin(0.5 * angle) ** 2 / x
    cxy, cxz, cyz = c * w[0] * w[1], c * w[0] * w[2], c * w[1] * w[2]
    xx, yy, zz = w[0] * w[0], w[1] * w[1], w[2] * w[2]
    return (
        1.0 - c * (yy + zz),
        cxy - s * w[2],
        cxz + s * w[1],
        cxy + s * w[2],
        1.0 - c * (xx + zz),
        cyz - s * w[0],
        cxz - s * w[1],
        cyz + s * w[0],
        1.0 - c * (xx + yy),
    )


@compiled
def turn_between(a: Rotation, b: Rotation) -> Triple:
    """Return the rotation vector log3(B A^T) in rad, which turns the axes A into the axes B, in base axes.

    Near half a turn its direction loses digits; no closed loop comes near that.
    """
    # Half the sum of the cross products of corresponding axes is sin(t) n; of their dot products, cos(t) + 1/2.
    sx = 0.5 * (a[3] * b[6] - a[6] * b[3] + a[4] * b[7] - a[7] * b[4] + a[5] * b[8] - a[8] * b[5])
    sy = 0.5 * (a[6] * b[0] - a[0] * b[6] + a[7] * b[1] - a[1] * b[7] + a[8] * b[2] - a[2] * b[8])
    sz = 0.5 * (a[0] * b[3] - a[3] * b[0] + a[1] * b[4] - a[4] * b[1] + a[2] * b[5] - a[5] * b[2])
    trace = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]
    cosine = 0.5 * (trace + a[6] * b[6] + a[7] * b[7] + a[8] * b[8] - 1.0)
    sine = math.sqrt(sx * sx + sy * sy + sz * sz)
    k = math.atan2(sine, cosine) / max(sine, 1e-300)
    return k * sx, k * sy, k * sz


@compiled
def log_coefficients(x: float) -> tuple[float, float, float]:
    """Return c(x) and its first and second derivative by x, for x = |w|^2.

    Above half a radian the second derivative is that of the truncated series; it only affects Newton's steps there.
    """
    second = 2 * _B2 + x * (6 * _B3 + x * (12 * _B4 + x * (20 * _B5 + x * (30 * _B6 + x * 42 * _B7))))
    if x < _SERIES_BELOW:
        c = _B0 + x * (_B1 + x * (_B2 + x * (_B3 + x * (_B4 + x * (_B5 + x * (_B6 + x * _B7))))))
        first = _B1 + x * (2 * _B2 + x * (3 * _B3 + x * (4 * _B4 + x * (5 * _B5 + x * (6 * _B6 + x * 7 * _B7)))))
        return c, first, second
    angle = math.sqrt(x)
    sine = math.sin(0.5 * angle)
    cotangent = math.cos(0.5 * angle) / sine
    c = (1.0 - 0.5 * angle * cotangent) / x
    slope = -2.0 / (x * angle) + 0.5 * cotangent / x + 0.25 / (angle * sine * sine)
    return c, slope / (2.0 * angle), second


@compiled
def residual_wrench(v: Triple, w: Triple, kt: float, kr: float) -> tuple[Triple, Triple]:
    """Return force and torque ``Jlog^T K e`` of a loop; v and w in the axes wanted (m, rad), kt N/m, kr Nm/rad."""
    c, c1, _ = log_coefficients(dot(w, w))
    wv = cross(w, v)
    u, q = cross(w, wv), cross(v, wv)
    k = 2.0 * c1 * dot(w, v)
    return scaled(kt, combined(v, -0.5, wv, c, u)), combined(scaled(kr, w), kt * c, q, kt * k, u)


@compiled
def wrench_stiffness(v: Triple, w: Triple, kt: float, kr: float, matrix: FloatArray, blocks: FloatArray) -> None:
    """Write W, the derivative of (force, torque) by the relative twist of frame b, into ``matrix`` (36,).

    ``d(f, tau) / d(v, w)`` times the blocks A, B of the module's formulas. W is not symmetric: its asymmetry is the
    bracket form of the wrench. ``blocks`` (6, 9) is working memory.
    """
    x, s, vv = dot(w, w), dot(w, v), dot(v, v)
    c, c1, c2 = log_coefficients(x)
    wv = cross(w, v)
    u, q = cross(w, wv), cross(v, wv)
    for i, (wi, vi, ui, qi) in enumerate(zip(w, v, u, q)):  # noqa: B905  (not known to the compiler)
        for j, (wj, vj) in enumerate(zip(w, v)):  # noqa: B905
            one = 1.0 if i == j else 0.0
            sign = 0.0 if i == j else (1.0 if (j - i) % 3 == 2 else -1.0)  # skew: (0,1) holds -z, (0,2) holds y
            third = 3 - i - j if i != j else 0
            w_hat, v_hat = sign * w[third], sign * v[third]
            w_hat2 = wi * wj - x * one
            du_dw = s * one + wi * vj - 2.0 * vi * wj
            at = 3 * i + j
            blocks[0, at] = one + 0.5 * w_hat + c * w_hat2
            blocks[1, at] = 0.5 * v_hat + c * (vi * wj + wi * vj - 2.0 * s * one) + 2.0 * c1 * s * w_hat2
            blocks[2, at] = kt * (one - 0.5 * w_hat + c * w_hat2)
            blocks[3, at] = kt * (0.5 * v_hat + c * du_dw + 2.0 * c1 * ui * wj)
            blocks[4, at] = kt * (c * (2.0 * wi * vj - s * one - vi * wj) + 2.0 * c1 * (ui * wj + s * w_hat2))
            bent = c * (vv * one - vi * vj) + 2.0 * c1 * (qi * wj + ui * vj + s * du_dw) + 4.0 * c2 * s * ui * wj
            blocks[5, at] = kr * one + kt * bent
    for i in range(3):
        for j in range(3):
            ll, la, al, aa = 0.0, 0.0, 0.0, 0.0
            for k in range(3):
                a, b = blocks[0, 3 * k + j], blocks[1, 3 * k + j]
                ll += blocks[2, 3 * i + k] * a
                la += blocks[2, 3 * i + k] * b + blocks[3, 3 * i + k] * a
                al += blocks[4, 3 * i + k] * a
                aa += blocks[4, 3 * i + k] * b + blocks[5, 3 * i + k] * a
            matrix[6 * i + j], matrix[6 * i + 3 + j] = ll, la
            matrix[6 * i + 18 + j], matrix[6 * i + 21 + j] = al, aa
