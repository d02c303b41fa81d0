"""Scenes are rendered once and kept in bounded memory."""

import shutil
from pathlib import Path

from rig import Placement, RigConfig
from rig.scene.material_folder import bundled_materials
from rig.simulation.scenes import BoundedCache, SceneRenderer, scene_bytes

SMALL = RigConfig().with_changes(camera={"width_px": 32, "height_px": 24})
SCENE_BYTES = 32 * 32 * (4 * 4 + 4 + 4 * 1 + 3 * 4)


def test_a_scene_is_rendered_once_for_all_rigs_of_one_configuration() -> None:
    cache, placement = BoundedCache(scene_bytes), Placement(surface="rock")
    first = SceneRenderer(SMALL, cache).render(placement)
    assert SceneRenderer(SMALL, cache).render(placement) is first
    brighter = SMALL.with_changes(simulation={"ambient": 0.5})
    assert SceneRenderer(brighter, cache).render(placement) is not first


def test_the_least_recently_used_scene_goes_first() -> None:
    cache = BoundedCache(scene_bytes, limit_bytes=2 * SCENE_BYTES)
    renderer = SceneRenderer(SMALL, cache)
    rock, sand, malv = (Placement(surface=name) for name in ("rock", "sand", "malv"))
    kept, lost = renderer.render(rock), renderer.render(sand)
    assert renderer.render(rock) is kept
    renderer.render(malv)
    assert renderer.render(rock) is kept
    assert renderer.render(sand) is not lost


def test_a_material_folder_is_rendered_anew(tmp_path: Path) -> None:
    folder = shutil.copytree(next(iter(bundled_materials().values())), tmp_path / "material")
    cache, placement = BoundedCache(scene_bytes), Placement(surface=str(folder))
    first = SceneRenderer(SMALL, cache).render(placement)
    assert SceneRenderer(SMALL, cache).render(placement) is not first


def test_a_cache_forgets_the_size_of_what_it_removed() -> None:
    cache = BoundedCache[bytes](len, limit_bytes=4)
    kept = [cache.get(number, lambda: bytes(2)) for number in range(5)]
    assert cache.get(4, lambda: b"") is kept[4]
    assert cache.get(3, lambda: b"") is kept[3]
    assert cache.get(2, lambda: b"") == b""


def test_a_value_larger_than_the_cache_is_not_kept() -> None:
    cache = BoundedCache[bytes](len, limit_bytes=4)
    assert cache.get("large", lambda: bytes(5)) == bytes(5)
    assert cache.get("large", lambda: b"") == b""
