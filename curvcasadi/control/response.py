"""What a linear model answers to: frequency responses, power spectra, motion in turbulence.

With H(ω) = C (iω − A)⁻¹ B + D from one input or parameter to one output, turbulence of the power
spectrum Φ gives the output the power spectrum |H|² Φ, whose integral over ω from 0 to ∞ is its mean
square. Dryden's spectra are those of white noise of unit intensity through the filters, τ = L/V,

    across:  σ √τ (1 + √3 τ s)/(1 + τ s)²,      along:  σ √(2 τ)/(1 + τ s),

and the covariance P of model and filter together solves A P + P Aᵀ + b bᵀ = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.aero.turbulence import Turbulence
from curvcasadi.control.linearize import LinearModel
from curvcasadi.symbolic.expressions import Array, choice, instance, numbers
from curvcasadi.symbolic.layout import Layout

#: Of rms values by quadrature.
TOLERANCE = 1e-6


def frequency_response(
    linear: LinearModel, omega: ArrayLike, source: str = "gust", output: str | None = None
) -> Array:
    """Complex amplitudes of outputs over that of an input or parameter.

    Parameters
    ----------
    linear : LinearModel
        Linear model, whose attitudes are error states.
    omega : array, shape (N,)
        Frequencies not below zero, rad/s.
    source : str
        Name of a part of u or p: a control surface, "gust", "pitch".
    output : str, optional
        Name of a part of y; all of y unless given.

    Returns
    -------
    ndarray, shape (entries of the output, entries of the source, N)
        Complex, unit of the output over that of the source.

    Raises
    ------
    ValueError
        If a name is unknown, a frequency is negative, or the model has an undamped root at one.
    """
    instance("linear", linear, LinearModel)
    frequencies = numbers("omega", omega).ravel()
    if np.any(frequencies < 0):
        raise ValueError(f"omega: expected frequencies of at least zero, found {frequencies.min()}")
    b, d = _columns(linear, source)
    c, d = _rows(linear, output, d)
    pencil = 1j * frequencies[:, None, None] * np.eye(len(linear.A)) - linear.A
    try:
        states = np.linalg.solve(pencil, b[None].astype(complex))
    except np.linalg.LinAlgError:
        raise ValueError("omega: expected frequencies without an undamped root") from None
    return np.moveaxis(c @ states + d, 0, -1)


def power_spectrum(
    linear: LinearModel,
    turbulence: Turbulence,
    omega: ArrayLike,
    output: str | None = None,
    source: str = "gust",
) -> Array:
    """Power spectra of outputs in turbulence.

    Parameters
    ----------
    linear : LinearModel
        Linear model about a stable state.
    turbulence : Turbulence
        The velocity of the air that `source` has; its speed is the airspeed of the model.
    omega : array, shape (N,)
        Frequencies not below zero, rad/s.
    output : str, optional
        Name of a part of y; all of y unless given.
    source : str
        Name of a part of u or p with one entry.

    Returns
    -------
    ndarray, shape (entries of the output, N)
        Unit of the output squared over rad/s; its integral from 0 to ∞ is the mean square.
    """
    _check(linear, turbulence)
    response = frequency_response(linear, omega, source, output)
    if response.shape[1] != 1:
        raise ValueError(f"source: expected a part of one entry, found {source!r}")
    spectrum = turbulence.spectrum(numbers("omega", omega).ravel())
    return np.asarray(np.abs(response[:, 0]) ** 2 * spectrum)


def rms_in_turbulence(
    linear: LinearModel, turbulence: Turbulence, output: str | None = None, source: str = "gust"
) -> Array:
    """Root mean squares of outputs in turbulence, about the state of the linear model.

    Parameters
    ----------
    linear : LinearModel
        Linear model about a stable state.
    turbulence : Turbulence
        The velocity of the air that `source` has; its speed is the airspeed of the model. Dryden's
        is a filter, for which the covariance is exact; von Kármán's spectrum is integrated.
    output : str, optional
        Name of a part of y; all of y unless given.
    source : str
        Name of a part of u or p with one entry.

    Returns
    -------
    ndarray, shape (entries of the output,)
        In the unit of the output.

    Raises
    ------
    ValueError
        If the model is not stable, a name is unknown, or the speeds differ.
    """
    _check(linear, turbulence)
    growth = float(np.max(linear.eigenvalues.real))
    if growth >= 0:
        raise ValueError(
            f"linear: expected a stable model, found a root of {growth:.3g} 1/s: its motion in "
            "turbulence grows without end"
        )
    b, d = _columns(linear, source)
    c, d = _rows(linear, output, d)
    if b.shape[1] != 1:
        raise ValueError(f"source: expected a part of one entry, found {source!r}")
    if turbulence.model == "dryden":
        return _rms_by_covariance(linear.A, b, c, d, turbulence)
    return _rms_by_quadrature(linear, turbulence, output, source)


def _rms_by_covariance(a: Array, b: Array, c: Array, d: Array, turbulence: Turbulence) -> Array:
    from scipy.linalg import solve_continuous_lyapunov

    filter_a, filter_b, filter_c = _dryden(turbulence)
    n, m = len(a), len(filter_a)
    whole = np.block([[a, b @ filter_c], [np.zeros((m, n)), filter_a]])
    noise = np.vstack([np.zeros((n, 1)), filter_b])
    covariance = solve_continuous_lyapunov(whole, -noise @ noise.T)
    rows = np.hstack([c, d @ filter_c])
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", rows, covariance, rows), 0.0))


def _dryden(turbulence: Turbulence) -> tuple[Array, Array, Array]:
    """A, B, C of the filter that makes the velocity of white noise of unit intensity."""
    tau, sigma = turbulence.scale / turbulence.speed, turbulence.intensity
    if turbulence.component == "longitudinal":
        return (
            np.array([[-1 / tau]]),
            np.array([[1 / tau]]),
            np.array([[sigma * np.sqrt(2 * tau)]]),
        )
    level = sigma * np.sqrt(tau) / tau**2
    return (
        np.array([[0.0, 1.0], [-1 / tau**2, -2 / tau]]),
        np.array([[0.0], [1.0]]),
        level * np.array([[1.0, np.sqrt(3) * tau]]),
    )


def _rms_by_quadrature(
    linear: LinearModel, turbulence: Turbulence, output: str | None, source: str
) -> Array:
    """Over log ω, with breaks at the roots, about which the integrand has its peaks."""
    from scipy.integrate import quad_vec

    roots = np.abs(linear.eigenvalues)
    corner = turbulence.speed / turbulence.scale
    low, high = np.log(1e-6 * min(corner, roots.min())), np.log(1e6 * max(corner, roots.max()))

    def integrand(z: float) -> Array:
        omega = np.exp(z)
        return omega * power_spectrum(linear, turbulence, [omega], output, source)[:, 0]

    square, _ = quad_vec(
        integrand, low, high, epsrel=TOLERANCE, norm="max", points=np.log(roots), limit=100000
    )
    return np.sqrt(square)


def _columns(linear: LinearModel, source: str) -> tuple[Array, Array]:
    """B and D of a part of u or p."""
    model = linear.model
    names = [part.name for part in (*model.u.parts, *model.p.parts)]
    choice("source", source, names)
    if source in model.u.slices:
        columns = model.u.slices[source]
        return linear.B[:, columns], linear.D[:, columns]
    columns = model.p.slices[source]
    return linear.B_p[:, columns], linear.D_p[:, columns]


def _rows(linear: LinearModel, output: str | None, d: Array) -> tuple[Array, Array]:
    """C and D of a part of y."""
    if output is None:
        return linear.C, d
    layout: Layout = linear.model.y
    choice("output", output, [part.name for part in layout.parts])
    rows = layout.slices[output]
    return linear.C[rows], d[rows]


def _check(linear: LinearModel, turbulence: Turbulence) -> None:
    instance("linear", linear, LinearModel)
    instance("turbulence", turbulence, Turbulence)
    where = linear.model.p.slices.get("airspeed")
    if where is not None and not np.allclose(linear.p[where], turbulence.speed, rtol=1e-6):
        raise ValueError(
            f"Turbulence.speed: expected the airspeed of the linear model, {linear.p[where][0]:g} "
            f"m/s, found {turbulence.speed:g}"
        )
