"""Which curvature brings the wing tip to a given pose?

    min_q  ½ qᵀ W q    subject to    p_tip(q) = p_d,   log(R_dᵀ R_tip(q)) = 0,   |q| ≤ 0.15 rad/m

The tip of the 16 m HALE wing shall rise by 6 m, slope by 40° and turn its leading edge up by 5°.
W measures strain energy: of all shapes that reach the pose, the one that is easiest to hold.
"""

from pathlib import Path

import casadi as ca
import numpy as np

import curvcasadi as cc
from curvcasadi.lie import so3
from curvcasadi.plotting import plot_shape, save_figure
from curvcasadi.reference_wings import hale_wing


def tip_pose(wing: cc.Beam) -> cc.Target:
    """The desired tip: 6 m up (body axes: z down), 40° slope, leading edge 5° up."""
    slope, twist = np.deg2rad(40), np.deg2rad(5)
    bent = so3.exp(ca.DM([0, -slope, 0])) @ so3.exp(ca.DM([twist, 0, 0]))
    return cc.Target(xi=1.0, position=[0, 14.3, -6], rotation=wing.root.rotation @ bent)


def main(directory: Path = Path("out")) -> cc.ShapeResult:
    wing = hale_wing()
    target = tip_pose(wing)
    result = cc.reach_shape(wing, [target], regularizer="strain_energy")

    print(f"remaining: {result.distances[0]:.1e} m, {result.angles[0]:.1e} rad")
    print(f"strain energy: {float(cc.strain_energy(wing, result.q)):.0f} J")
    for label, weight in zip(wing.basis.labels, result.q.full().ravel(), strict=True):
        print(f"  {label:26s} {weight:+.4f} rad/m")

    directory.mkdir(exist_ok=True)
    save_figure(plot_shape(wing, result.q, both=False), directory / "reach_tip_pose.png")

    try:
        cc.reach_shape(wing, [cc.Target(xi=1.0, position=[0, 17, 0])])
    except cc.ConvergenceError as error:
        print(f"a tip 1 m beyond the span: {error}")
    return result


if __name__ == "__main__":
    main()
