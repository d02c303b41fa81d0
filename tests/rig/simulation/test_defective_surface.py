"""Defects on a surface: relief and gradients agree, and a defect stays where it is on the part."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from classify.base.errors import InputError
from classify.lighting import Lighting
from rig import Defect, Placement, RigConfig
from rig.config.simulation import RELIEF_KINDS, DefectKind
from rig.scene.render import render_frame
from rig.scene.surfaces import PeriodicSurface, View
from rig.scene.synthetic import synthetic_surface
from rig.simulation.defective_surface import DefectiveSurface
from rig.simulation.scenes import SceneRenderer

SIDE_PX = 128
RING = Lighting.ring(45.0)
KINDS = get_args(DefectKind)
FLAT = PeriodicSurface.from_height(np.zeros((64, 64)), np.full((64, 64), 0.8), "flat")
WAVES = PeriodicSurface.from_height(
    2.0 * np.sin(2.0 * np.pi * np.arange(64) / 32.0) * np.ones((64, 1)),
    np.full((64, 64), 0.3),
    "waves",
)
MALV = synthetic_surface("malv", 3, 256)


def defective(surface: PeriodicSurface, kind: DefectKind, **fields: float) -> DefectiveSurface:
    name = "waves" if kind == "foreign" else None
    return DefectiveSurface(surface, (Defect(kind=kind, surface=name, **fields),), {"waves": WAVES})


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=5)
@given(
    rotate_deg=st.floats(-180.0, 180.0),
    angle_deg=st.floats(-180.0, 180.0),
    magnification=st.floats(1.0, 2.0),
)
def test_gradients_are_the_derivatives_of_the_height(
    kind: DefectKind, rotate_deg: float, angle_deg: float, magnification: float
) -> None:
    with_defect = defective(
        MALV, kind, x_px=5.0, y_px=-3.0, size_px=32.0, depth_px=1.5, angle_deg=angle_deg
    )
    # Fine enough for central differences.
    patch = with_defect.patch(View(256, rotate_deg, (4.0, -2.0), 0, 4.0 * magnification))
    q, p = np.gradient(patch.height)
    error = np.hypot(p - patch.p, -q - patch.q)[1:-1, 1:-1]
    assert error.max() < 0.05 * max(np.abs(patch.p).max(), np.abs(patch.q).max())


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=5)
@given(rotate_deg=st.sampled_from((90.0, 180.0, 270.0)), angle_deg=st.floats(-180.0, 180.0))
def test_a_defect_rotates_with_the_part(
    kind: DefectKind, rotate_deg: float, angle_deg: float
) -> None:
    surface = defective(MALV, kind, x_px=12.0, y_px=7.0, angle_deg=angle_deg)
    quarters = round(rotate_deg / 90.0)
    still, rotated = surface.patch(View(SIDE_PX)), surface.patch(View(SIDE_PX, rotate_deg))
    np.testing.assert_allclose(rotated.height, np.rot90(still.height, quarters), atol=2e-3)
    np.testing.assert_allclose(rotated.albedo, np.rot90(still.albedo, quarters), atol=1e-4)
    mask = surface.mask(SIDE_PX, rotate_deg)
    assert (mask == np.rot90(surface.mask(SIDE_PX), quarters)).mean() > 0.999


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=5)
@given(
    x=st.floats(-20.0, 20.0),
    y=st.floats(-20.0, 20.0),
    shift=st.tuples(st.integers(-10, 10), st.integers(-10, 10)),
)
def test_a_defect_is_at_its_place_on_the_part(
    kind: DefectKind, x: float, y: float, shift: tuple[int, int]
) -> None:
    surface = defective(MALV, kind, x_px=x, y_px=y)
    patch, plain = surface.patch(View(SIDE_PX, 0.0, shift)), MALV.patch(View(SIDE_PX, 0.0, shift))
    relief, albedo = np.abs(patch.height - plain.height), np.abs(patch.albedo - plain.albedo)
    changed = (relief > 0.25) | (albedo > 0.05)
    mask = surface.mask(SIDE_PX, 0.0, shift)
    assert mask[changed].mean() > 0.95
    rows, cols = np.nonzero(mask)
    middle = 0.5 * (SIDE_PX - 1)
    assert cols.mean() - middle == pytest.approx(x - shift[0], abs=1.5)
    assert middle - rows.mean() == pytest.approx(y - shift[1], abs=1.5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_defect_beyond_the_frame_changes_nothing(kind: DefectKind) -> None:
    patch = defective(MALV, kind, x_px=5000.0).patch(View(SIDE_PX, 30.0))
    np.testing.assert_array_equal(patch.height, MALV.patch(View(SIDE_PX, 30.0)).height)


def test_dents_bumps_and_scratches_have_their_depth() -> None:
    heights = {
        kind: defective(FLAT, kind, x_px=0.5, y_px=0.5, size_px=30.0, depth_px=2.0)
        .patch(View(SIDE_PX))
        .height
        for kind in RELIEF_KINDS
    }
    assert heights["dent"].min() == pytest.approx(-2.0, abs=1e-3)
    assert heights["dent"].max() <= 0.0
    np.testing.assert_array_equal(heights["bump"], -heights["dent"])
    scratch = heights["scratch"]
    assert scratch.min() == pytest.approx(-2.0, abs=1e-3)
    assert 0.3 < scratch.max() / 2.0 < 0.5
    assert abs(scratch.sum()) < 0.02 * np.abs(scratch).sum()  # ploughed, not cut


def test_a_stain_changes_the_albedo_alone_and_a_relief_defect_the_relief_alone() -> None:
    plain = MALV.patch(View(SIDE_PX))
    stained = defective(MALV, "stain", contrast=0.5).patch(View(SIDE_PX))
    np.testing.assert_array_equal(stained.p, plain.p)
    assert (stained.albedo / plain.albedo).min() == pytest.approx(0.5)
    dented = defective(MALV, "dent").patch(View(SIDE_PX))
    np.testing.assert_array_equal(dented.albedo, plain.albedo)


def test_a_missing_texture_is_a_plane_and_a_foreign_one_has_its_own_relief() -> None:
    middle = (slice(58, 70), slice(58, 70))
    missing = defective(MALV, "missing", size_px=48.0).patch(View(SIDE_PX))
    assert np.ptp(missing.p[middle]) < 1e-5
    assert np.ptp(missing.albedo[middle]) < 1e-5
    assert abs(missing.height - MALV.patch(View(SIDE_PX)).height)[middle].mean() < MALV.height.std()
    foreign = defective(FLAT, "foreign", size_px=48.0, angle_deg=90.0).patch(View(SIDE_PX))
    np.testing.assert_allclose(foreign.albedo[middle], 0.3, atol=1e-5)
    # Waves along x, rotated by 90 degrees.
    assert foreign.q[middle].std() > 10.0 * foreign.p[middle].std()


def test_a_bump_casts_a_shadow_into_the_frame() -> None:
    # 9 px beyond the right edge of the frame, and twice as high as it is wide.
    bump = defective(FLAT, "bump", x_px=40.0, size_px=16.0, depth_px=32.0)
    scene = render_frame(bump, RING, 64)
    assert scene.shadowed[0, 32, 40:].all()
    assert not scene.shadowed[2, 32, 10:40].any()


def test_a_placed_part_shows_its_defects_and_its_set_names_them() -> None:
    config = RigConfig().with_changes(camera={"width_px": 64, "height_px": 64})
    renderer = SceneRenderer(config)
    plain = renderer.render(Placement())
    defects = (Defect(kind="dent"), Defect(kind="foreign", surface="Leather037", x_px=8.0))
    scene = renderer.render(Placement(defects=defects))
    assert (scene.p != plain.p).mean() > 0.1
    placement = Placement.model_validate_json(Placement(defects=defects).model_dump_json())
    assert placement.defects == defects


def test_a_calibration_target_is_no_foreign_texture() -> None:
    renderer = SceneRenderer(RigConfig().with_changes(camera={"width_px": 32, "height_px": 32}))
    with pytest.raises(InputError, match=r"defects: surface 'plate' is a calibration target"):
        renderer.render(Placement(defects=(Defect(kind="foreign", surface="plate"),)))


@pytest.mark.parametrize("fields", [{"kind": "foreign"}, {"kind": "dent", "surface": "waves"}])
def test_a_foreign_texture_and_no_other_defect_has_a_surface(fields: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="surface"):
        Defect.model_validate(fields)
