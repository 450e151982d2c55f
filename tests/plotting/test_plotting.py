"""Figures: what they show, with labels and units, and that files are written."""

import re
from collections import defaultdict
from dataclasses import replace

import casadi as ca
import matplotlib.animation
import numpy as np
import pytest
from mpl_toolkits.mplot3d import Axes3D
from PIL import Image

import curvcasadi
from curvcasadi import plotting
from curvcasadi.aero import AerodynamicLoad, Flow, StripAerodynamics, strip_forces
from curvcasadi.beam.basis import ChannelBasis, VectorBasis
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.families import BSpline, Legendre, PiecewiseConstant
from curvcasadi.beam.grid import Grid
from curvcasadi.beam.mirror import mirror
from curvcasadi.beam.pose import Pose
from curvcasadi.files import load_aircraft
from curvcasadi.kinematics.shape import pose_at, shape_map
from curvcasadi.loads.kinds import PointForce, PointMoment
from curvcasadi.ocp.targets import Target
from curvcasadi.plotting import animation, content, scene
from curvcasadi.plotting.arrows import ALONG, Arrows, load_arrows, with_mirror_images
from curvcasadi.reference_wings import hale_wing

WING = hale_wing()
BENT = np.array([0.01, 0, 0, -0.05, 0.05, 0, 0, 0.005, 0])


def lines(axes, label):
    """Points (k, 3) of each line of this label, hidden from the legend or not."""
    return [
        np.array(line.get_data_3d()).T
        for line in axes.get_lines()
        if str(line.get_label()).lstrip("_") == label
    ]


@pytest.fixture
def arrows(monkeypatch):
    """What figures draw as arrows: (start, end) of each (k, 2, 3), and colour; by label."""
    drawn, quiver = defaultdict(list), Axes3D.quiver

    def record(axes, x, y, z, u, v, w, **options):
        start, along = np.column_stack([x, y, z]), np.column_stack([u, v, w])
        ends = np.stack([start, start + along], axis=1)
        drawn[options["label"].lstrip("_")].append((ends, options["color"]))
        return quiver(axes, x, y, z, u, v, w, **options)

    monkeypatch.setattr(Axes3D, "quiver", record)
    return drawn


class TestBasis:
    def test_axes_have_names_units_and_a_legend_of_the_labels(self):
        basis = ChannelBasis(torsion=Legendre(2), in_plane=BSpline(5))
        figure = plotting.plot_basis(basis)
        assert [axes.get_title() for axes in figure.axes] == ["torsion, $K_x$", "in-plane, $K_z$"]
        assert {axes.get_ylabel() for axes in figure.axes} == {"value [-]"}
        assert figure.axes[-1].get_xlabel() == r"$\xi = s/L$ [-]"
        texts = [t.get_text() for axes in figure.axes for t in axes.get_legend().get_texts()]
        assert tuple(texts) == basis.labels

    def test_curves_are_the_basis_functions(self):
        basis = ChannelBasis(out_of_plane=Legendre(3))
        for k, line in enumerate(plotting.plot_basis(basis).axes[0].get_lines()):
            xi, values = (data[~np.isnan(line.get_ydata())] for data in line.get_data())
            np.testing.assert_array_equal(values, [basis(x)[1, k] for x in xi])
            assert xi.min() < 1e-9 and xi.max() > 1 - 1e-9

    def test_jumps_are_gaps_not_slopes(self):
        line = (
            plotting.plot_basis(ChannelBasis(torsion=PiecewiseConstant(3))).axes[0].get_lines()[1]
        )
        values = line.get_ydata()
        assert set(values[~np.isnan(values)]) == {0.0, 1.0}
        steps = np.abs(np.diff(values))
        assert np.nanmax(steps) == 0  # each jump stands beside a NaN

    def test_coupled_functions_show_in_each_curvature_that_they_drive(self):
        basis = VectorBasis(lambda xi: np.array([[1.0, 0], [xi, 1], [0, 0]]), 2)
        figure = plotting.plot_basis(basis)
        labels = [[line.get_label() for line in axes.get_lines()] for axes in figure.axes]
        assert labels == [["coupled: 0"], ["coupled: 0", "coupled: 1"]]

    def test_the_figure_is_written_as_png(self, tmp_path):
        plotting.save_figure(plotting.plot_basis(WING.basis), tmp_path / "basis.png")
        assert Image.open(tmp_path / "basis.png").format == "PNG"

    def test_an_unknown_format_is_refused_with_the_name_of_the_file(self, tmp_path):
        path = tmp_path / "basis.xyz"
        with pytest.raises(ValueError, match=f"{re.escape(str(path))}: .*xyz"):
            plotting.save_figure(plotting.plot_basis(WING.basis), path)


class TestShape:
    def test_both_half_wings_pass_through_the_stations_of_the_shape_map(self):
        curves = lines(plotting.plot_shape(WING, BENT).axes[0], "deformed")
        assert len(curves) == 2
        for curve, wing in zip(curves, (WING, mirror(WING)), strict=True):
            for station in shape_map(wing, BENT).positions.full().T:
                # The same arithmetic on 16 m: only rounding, some 1e-15 of the length, remains.
                assert np.min(np.linalg.norm(curve - station, axis=1)) < 1e-13

    def test_one_half_wing_is_drawn_on_demand(self):
        axes = plotting.plot_shape(WING, BENT, both=False).axes[0]
        assert len(lines(axes, "deformed")) == len(lines(axes, "undeformed")) == 1

    def test_the_undeformed_wing_is_straight_and_can_be_left_out(self):
        axes = plotting.plot_shape(WING, BENT).axes[0]
        right, left = lines(axes, "undeformed")
        np.testing.assert_allclose(right[:, [0, 2]], 0, atol=1e-13)
        np.testing.assert_allclose((right[-1, 1], left[-1, 1]), (16, -16), atol=1e-13)
        assert not lines(plotting.plot_shape(WING, BENT, undeformed=False).axes[0], "undeformed")

    def test_the_undeformed_wing_need_not_be_within_the_weight_bounds(self):
        bounds = (np.where(BENT == 0, -0.1, BENT - 0.001), np.where(BENT == 0, 0.1, BENT + 0.001))
        plotting.plot_shape(replace(WING, weight_bounds=bounds), BENT)

    @pytest.mark.parametrize(("column", "axis"), [*enumerate("xyz")])
    def test_arrows_are_the_local_axes_in_red_green_and_blue(self, arrows, column, axis):
        plotting.plot_shape(WING, BENT, both=False)
        ((found, color),) = arrows[f"local {axis}"]
        start, end = found[-1]
        tip = shape_map(WING, BENT).tip
        # Rounding of 16 m.
        np.testing.assert_allclose(start, tip.position.full().ravel(), atol=1e-12)
        direction = (end - start) / np.linalg.norm(end - start)
        np.testing.assert_allclose(direction, tip.rotation.full()[:, column], atol=1e-12)
        assert color == ("tab:red", "tab:green", "tab:blue")[column]

    def test_axes_have_units_equal_scales_and_a_legend(self):
        figure = plotting.plot_shape(WING, BENT)
        axes = figure.axes[0]
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
        texts = [text.get_text() for text in figure.legends[0].get_texts()]
        assert texts == ["undeformed", "deformed", "local x", "local y", "local z"]
        ranges = [abs(np.diff(getattr(axes, f"get_{k}lim")())[0]) for k in "xyz"]
        scale = axes.get_box_aspect() / ranges
        np.testing.assert_allclose(scale, scale[0], rtol=1e-12)

    def test_body_axes_are_turned_half_a_turn_about_x(self):
        axes = plotting.plot_shape(WING, BENT).axes[0]
        assert axes.get_zlabel() == "z [m], down"
        assert not axes.xaxis_inverted()
        # Two axes inverted are a rotation; one alone would draw a mirror image.
        assert axes.yaxis_inverted() and axes.zaxis_inverted()

    def test_axes_with_z_up_are_drawn_as_they_are(self):
        lone = replace(WING, root=Pose.identity())
        axes = plotting.plot_shape(lone, BENT, both=False).axes[0]
        assert axes.get_zlabel() == "z [m]"
        inverted = (axes.xaxis_inverted(), axes.yaxis_inverted(), axes.zaxis_inverted())
        assert inverted == (False, False, False)

    def test_the_direction_of_z_can_be_said(self):
        axes = plotting.plot_shape(mirror(WING), BENT, both=False, z_down=True).axes[0]
        assert axes.zaxis_inverted()

    def test_the_whole_wing_is_in_view(self):
        axes = plotting.plot_shape(WING, BENT).axes[0]
        points = np.concatenate([*lines(axes, "deformed"), *lines(axes, "undeformed")])
        for k, name in enumerate("xyz"):
            low, high = sorted(getattr(axes, f"get_{name}lim")())
            assert low < points[:, k].min() and points[:, k].max() < high

    def test_close_stations_share_an_arrow(self, arrows):
        plotting.plot_shape(WING, BENT, both=False)
        ((found, _),) = arrows["local x"]
        assert len(found) < len(WING.stations)
        gaps = np.linalg.norm(np.diff(found[:, 0], axis=0), axis=1)
        # Chords are a little shorter than the arcs that they span.
        assert np.all(gaps > 0.98 * scene.GAP * WING.length)

    def test_weights_that_break_a_bound_are_refused(self):
        with pytest.raises(ValueError, match=r"q\[0\] \(torsion: Legendre 0\): expected within"):
            plotting.plot_shape(WING, 10 * BENT + 1)

    def test_a_symbolic_length_is_refused(self):
        beam = Beam(length=ca.MX.sym("L"), basis=WING.basis, grid=Grid.uniform(4))
        with pytest.raises(ValueError, match=r"Beam\.length: a figure needs a number"):
            plotting.plot_shape(beam, BENT)


STRIPS = StripAerodynamics(
    chord=lambda xi: 1.6 - 0.9 * xi, aerodynamic_center=0.1, lift_slope=2 * np.pi
)


class TestParts:
    def test_surfaces_have_the_chord_of_the_strips_and_lie_along_the_local_y_axis(self):
        axes = plotting.plot_shape(WING, BENT, strips=STRIPS, both=False).axes[0]
        (outline,) = lines(axes, "outline")
        half = len(outline) // 2
        # From the leading edge at the root to the trailing one there: the chord of 1.6 m.
        np.testing.assert_allclose(outline[0] - outline[2 * half - 1], [1.6, 0, 0], atol=1e-12)
        (wing,) = content.half_wings(WING, BENT, None, both=False, strips=STRIPS)
        leading, trailing = wing.outline(wing.history, 0)
        tip = shape_map(WING, BENT).tip
        across = tip.rotation.full()[:, 1]
        np.testing.assert_allclose(leading[:, -1] - trailing[:, -1], 0.7 * across, atol=1e-12)
        np.testing.assert_allclose(
            leading[:, -1] - tip.position.full()[:, 0], (0.1 + 0.7 / 4) * across, atol=1e-12
        )

    def test_loads_are_arrows_in_parent_axes_with_their_size_in_the_legend(self, arrows):
        loads = [
            PointForce(1.0, (0, 0, -100.0)),
            PointForce(0.5, (0, 0, 20.0), "follower"),
            PointMoment(1.0, (3.0, 0, 0)),
        ]
        plotting.plot_shape(WING, BENT, loads=loads, both=False)
        shape = shape_map(WING, BENT)
        (((start, end),), _) = arrows["force, largest 100 N"][0]
        np.testing.assert_allclose(start, shape.tip.position.full().ravel(), atol=1e-12)
        np.testing.assert_allclose(end - start, [0, 0, -0.2 * WING.length], atol=1e-12)
        (((start, end),), _) = arrows["force, largest 20 N"][0]
        normal = pose_at(WING, BENT, 0.5).rotation.full()[:, 2]
        np.testing.assert_allclose(end - start, 0.2 * WING.length * normal, atol=1e-12)
        assert "moment, largest 3 N m" in arrows

    def test_loads_of_the_mirror_image_are_mirrored(self):
        force, moment = (
            Arrows("force", "N", *np.ones((2, 3, 1))),
            Arrows("moment", "N m", *np.ones((2, 3, 1))),
        )
        force, moment = with_mirror_images([force, moment])
        np.testing.assert_array_equal(force.points[:, 1], [1, -1, 1])
        np.testing.assert_array_equal(force.values[:, 1], [1, -1, 1])
        np.testing.assert_array_equal(moment.values[:, 1], [-1, 1, -1])

    def test_airloads_sum_up_to_the_force_of_the_strips(self):
        flow = Flow(velocity=(25.0, 0, 2.0), density=0.0889)
        (found,) = load_arrows(WING, BENT, [AerodynamicLoad(strips=STRIPS, flow=flow)])
        strips = strip_forces(
            WING, BENT, AerodynamicLoad(strips=STRIPS, flow=flow), stations=ALONG.tolist()
        )
        # Lift and drag are the components of the same force in the section plane.
        expected = np.hypot(strips.lift.full(), strips.drag.full()).ravel()
        np.testing.assert_allclose(np.linalg.norm(found.values, axis=0), expected, rtol=1e-12)

    def test_a_load_that_cannot_be_drawn_is_named(self):
        with pytest.raises(ValueError, match=r"loads: expected Gravity, .* found str"):
            plotting.plot_shape(WING, BENT, loads=["lift"])

    def test_targets_are_drawn_where_they_are(self, arrows):
        target = Target(xi=1.0, position=(0, 14, -7), rotation=WING.root.rotation)
        axes = plotting.plot_shape(WING, BENT, targets=[target]).axes[0]
        (star,) = lines(axes, "target")
        np.testing.assert_array_equal(star, [[0, 14, -7]])
        assert len(arrows["target axis"]) == 3

    def test_an_aircraft_has_its_own_half_wings_tail_and_centre_of_mass(self):
        aircraft = load_aircraft("ocp_examples/hale_aircraft.toml")
        q = {wing.name: BENT for wing in aircraft.beams}
        figure = plotting.plot_shape(aircraft, q)
        axes = figure.axes[0]
        assert len(lines(axes, "deformed")) == 2
        (center,) = lines(axes, "centre of mass of the body")
        np.testing.assert_array_equal(center, [[0, 0, 0]])
        (tail,) = aircraft.surfaces
        a, b, c, _ = content.corners(tail).T
        area = np.linalg.norm(np.cross(b - a, c - b))
        np.testing.assert_allclose(area, float(tail.area), rtol=1e-12)
        with pytest.raises(ValueError, match="weights: expected a mapping from"):
            plotting.plot_shape(aircraft, BENT)

    def test_exaggeration_stretches_the_page_and_not_the_data(self):
        plain, tall = (plotting.plot_shape(WING, BENT, exaggeration=e).axes[0] for e in (1, 3))
        np.testing.assert_array_equal(lines(plain, "deformed")[0], lines(tall, "deformed")[0])
        ranges = [abs(np.diff(getattr(tall, f"get_{k}lim")())[0]) for k in "xyz"]
        scale = tall.get_box_aspect() / ranges
        np.testing.assert_allclose(scale / scale[0], [1, 1, 3], rtol=1e-12)
        assert tall.get_zlabel() == "z [m], down, scale × 3"

    def test_the_camera_and_the_title_can_be_said(self):
        figure = plotting.plot_shape(WING, BENT, camera=(10, -120), title="bent")
        assert (figure.axes[0].elev, figure.axes[0].azim) == (10, -120)
        assert figure.get_suptitle() == "bent"

    def test_every_picture_has_a_title(self):
        for figure in (plotting.plot_shape(WING, BENT), plotting.plot_basis(WING.basis)):
            assert figure.get_suptitle()

    def test_pictures_are_names_of_the_package(self):
        assert curvcasadi.plot_shape is plotting.plot_shape
        assert set(plotting.__all__) <= set(curvcasadi.__all__)
        with pytest.raises(AttributeError, match="no attribute 'plot_nothing'"):
            _ = curvcasadi.plot_nothing


class TestAnimation:
    TIMES = np.linspace(0, 0.4, 5)
    HISTORY = np.outer(np.linspace(0, 1, 5), BENT)

    def test_a_gif_has_a_frame_for_each_sample_and_plays_in_real_time(self, tmp_path, capsys):
        plotting.animate_shape(WING, self.TIMES, self.HISTORY, tmp_path / "wing.gif")
        with Image.open(tmp_path / "wing.gif") as image:
            assert image.format == "GIF" and image.n_frames == 5
            assert image.info["duration"] == 100  # ms
        assert "wing.gif: 100%" in capsys.readouterr().err

    def test_the_progress_bar_can_be_left_out(self, tmp_path, capsys):
        path = tmp_path / "wing.gif"
        plotting.animate_shape(WING, None, self.HISTORY[:2], path, both=False, progress=False)
        assert capsys.readouterr().err == ""

    def test_dense_samples_are_thinned_to_the_largest_frame_rate(self):
        samples, rate = animation.frames(np.linspace(0, 2, 1001))
        assert rate == animation.LARGEST_FRAME_RATE
        assert samples == list(range(0, 1001, 20))  # 2 s at 25 frames a second: every 0.04 s

    def test_uneven_samples_are_held_until_the_next_is_nearer(self):
        samples, rate = animation.frames(np.array([0.0, 3.0, 4.0, 5.0]))
        assert rate == pytest.approx(3 / 5)
        assert samples == [0, 1, 1, 3]  # frames at 0, 5/3, 10/3 and 5 s

    @pytest.mark.parametrize(("name", "found"), [("wing.avi", ".avi"), ("wing", "no ending")])
    def test_another_extension_is_refused(self, tmp_path, name, found):
        expected = f"expected a file name that ends in .gif or .mp4, found {found}"
        with pytest.raises(ValueError, match=re.escape(expected)):
            plotting.animate_shape(WING, self.TIMES, self.HISTORY, tmp_path / name)

    def test_a_missing_ffmpeg_is_named(self, tmp_path, monkeypatch):
        monkeypatch.setattr(
            matplotlib.animation.FFMpegWriter, "isAvailable", classmethod(lambda cls: False)
        )
        with pytest.raises(ValueError, match=r"wing\.mp4: .*ffmpeg.*apt-get install ffmpeg"):
            plotting.animate_shape(WING, self.TIMES, self.HISTORY, tmp_path / "wing.mp4")

    def test_one_sample_is_no_animation(self, tmp_path):
        with pytest.raises(ValueError, match="two samples or more, found 1"):
            plotting.animate_shape(WING, [0.0], self.HISTORY[:1], tmp_path / "wing.gif")
