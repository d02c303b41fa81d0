"""The first run, which compiles the kernels, gives the numbers of all later runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

# Prints digests of each map, spectrum and statistic, and distances.
PROGRAM = """
import hashlib
import numpy as np
from classify import Lighting, TextureLibrary, photometric_stereo
from rig.scene.render import render_frame
from rig.scene.synthetic import synthetic_surface

lighting = Lighting.ring(60.0)
scene = render_frame(synthetic_surface("sand", 0, 256), lighting, 192)
noise = np.random.default_rng(0).normal(0.0, 8.0, scene.lights.shape)
images = np.clip(np.rint(3000.0 * scene.lights + noise), 0, 4095).astype(np.uint16)
first, second = (
    photometric_stereo(part, lighting, full_scale=4095)
    for part in (images[:, :128, :128], images[:, 64:, 64:])
)
library = TextureLibrary.train([("first", first), ("second", second)])
shown = {"p": first.p, "q": first.q, "albedo": first.albedo, "scene": scene.lights}
shown |= {"signature": library.observe(second), "references": library.signatures}
for name, values in shown.items():
    print(name, hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest())
match = library.classify(first)
print(match.distance, match.runner_up_distance, match.orientation_deg)
"""


@pytest.mark.slow
def test_the_run_that_compiles_gives_the_numbers_of_later_runs(tmp_path: Path) -> None:
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    command = [sys.executable, "-c", PROGRAM]
    compiling, cached = (
        subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
        for _ in range(2)
    )
    assert any(tmp_path.rglob("*.nbc"))
    assert compiling == cached
