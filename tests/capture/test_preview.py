"""`ps4rig rig preview`: images, server, page, and errors of the rig."""

import json
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from capture.session.live_view import Outline
from capture.session.preview_loop import Preview, preview_image, run_preview, serving
from classify.base.errors import InputError
from firmware_sim import RealClock, SimulatedBoard, SimulatedController, serve_pty
from rig import Frame, RigConfig, open_rig
from rig.fresh_frame import fresh_frame
from tests.waiting import until_so

SMALL = RigConfig().with_changes(camera={"width_px": 64, "height_px": 48})
# Long enough for a busy machine to compile the kernels.
WAIT_S = 120.0


def has_all_images(preview: Preview) -> bool:
    lights = preview.state()["lights"]
    return bool(lights) and all(light["sequence"] is not None for light in lights)


@contextmanager
def running(preview: Preview, config: RigConfig) -> Iterator[threading.Event]:
    stopping = threading.Event()
    thread = threading.Thread(target=run_preview, args=(config, preview, stopping))
    thread.start()
    try:
        yield stopping
    finally:
        stopping.set()
        thread.join(WAIT_S)
        assert not thread.is_alive()


def get(url: str, host: str | None = None) -> tuple[int, bytes, Any]:
    request = urllib.request.Request(url, headers={} if host is None else {"Host": host})
    try:
        with urllib.request.urlopen(request, timeout=WAIT_S) as answer:
            return answer.status, answer.read(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read(), error.headers


# a frame


def frame_of(pixels: np.ndarray, bit_depth: int) -> Frame:
    return Frame(pixels, bit_depth, 1.0, 1.02, 7)


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (12, np.uint16), (16, np.uint16)])
def test_one_saturated_pixel_is_red_however_large_the_frame(bits: int, dtype: type) -> None:
    pixels = np.full((1500, 2000), 2 ** (bits - 1), dtype)
    pixels[701, 1203] = 2**bits - 1
    shown = preview_image(frame_of(pixels, bits))
    image = cv2.imdecode(np.frombuffer(shown.png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (600, 800, 3)
    red = (image == (40, 40, 255)).all(axis=2)
    assert 1 <= red.sum() <= 16
    assert np.abs(np.argwhere(red).mean(axis=0) - (701 / 2.5, 1203 / 2.5)).max() < 3
    assert (image[~red] == 128).all()
    assert shown.saturated_share == pytest.approx(1 / 3e6)
    assert len(shown.histogram) == 64
    assert shown.histogram[32] == pytest.approx(1.0, abs=1e-3)


def test_the_focus_score_falls_with_blur_and_not_with_brightness() -> None:
    rng = np.random.default_rng(1)
    sharp = rng.integers(500, 3000, (200, 200)).astype(np.uint16)
    scores = [
        preview_image(frame_of(cv2.GaussianBlur(sharp, (0, 0), sigma), 12)).focus
        for sigma in (0.3, 0.8, 2.0)
    ]
    assert scores == sorted(scores, reverse=True)
    dark, bright = (preview_image(frame_of(pixels, 12)).focus for pixels in (sharp // 2, sharp))
    assert dark == pytest.approx(bright, rel=0.01)


# the rig's side


def test_every_led_is_shown_repeatedly() -> None:
    preview = Preview()
    with running(preview, SMALL):
        until_so(lambda: has_all_images(preview))
        first = preview.state()
        until_so(lambda: preview.state()["lights"][0]["sequence"] > first["lights"][0]["sequence"])
    assert first["simulated"]
    assert first["error"] is None
    assert [light["name"] for light in first["lights"]][1] == "LED 1, tilt 90°"
    assert all(0.0 < light["age_s"] < WAIT_S for light in first["lights"])
    assert len({preview.png(light) for light in range(4)}) == 4
    assert preview.png(4) is None


@pytest.mark.slow
def test_a_hardware_error_is_named_and_the_rig_opened_again() -> None:
    gone = {"frames": [{"kind": "gone", "when": {"from_s": 2.0}}]}
    preview = Preview()
    with running(preview, SMALL.with_changes(simulation={"faults": gone})):
        error = until_so(lambda: preview.state()["error"])
        assert "no frame" in error or "gone" in error
        # The plan of faults starts again with the new rig.
        until_so(lambda: preview.state()["error"] is None)


# the server


def preview_of_age(age_s: float) -> Preview:
    """One image of each LED, exposed `age_s` ago on a clock that stands still."""
    with open_rig(SMALL) as rig:
        preview = Preview(now_s=lambda: rig.clock.now_s() + age_s)
        preview.note_opened_rig(rig)
        for light in range(4):
            preview.store_image(light, preview_image(fresh_frame(rig, light)))
    return preview


@pytest.fixture(scope="module")
def shown() -> Preview:
    return preview_of_age(0.1)


def test_an_image_that_is_not_renewed_ages(shown: Preview) -> None:
    ages_s = [light["age_s"] for light in shown.state()["lights"]]
    older_s = [light["age_s"] for light in preview_of_age(7.1).state()["lights"]]
    assert older_s == pytest.approx([age_s + 7.0 for age_s in ages_s])


def test_the_page_its_state_and_its_images_are_served(shown: Preview) -> None:
    with serving(shown, 0) as server:
        assert server.url.startswith("http://127.0.0.1:")
        status, page, headers = get(server.url)
        assert status == 200
        assert b"page.js" in page
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert json.loads(get(server.url + "state.json")[1])["lights"][2]["saturated_share"] == 0
        assert get(server.url + "light/2.png?17")[1] == shown.png(2)
        assert get(server.url + "page.js")[2]["Content-Type"].startswith("text/javascript")


@pytest.mark.parametrize(
    "path",
    ["light/9.png", "light/-1.png", "light/٣.png", "light/.png", "../rig.toml", "page.html", "x"],
)
def test_other_paths_are_not_served(shown: Preview, path: str) -> None:
    with serving(shown, 0) as server:
        assert get(server.url + urllib.request.quote(path))[0] == 404


def test_an_outline_is_served_where_there_is_one() -> None:
    preview = preview_of_age(0.1)
    with serving(preview, 0) as server:
        assert get(server.url + "overlay.svg")[0] == 404
        assert preview.state()["overlay"] is None
        preview.guide("turn to 40 degrees", Outline(64, 48, ()).svg())
        status, svg, headers = get(server.url + "overlay.svg?1")
        assert (status, headers["Content-Type"]) == (200, "image/svg+xml")
        assert svg.startswith(b"<svg")
        state = json.loads(get(server.url + "state.json")[1])
        assert (state["guide"], state["overlay"]) == ("turn to 40 degrees", 1)
        assert state["places"]["size"] == pytest.approx(1 / 3, abs=1e-3)
        preview.guide("first placement", None)
        assert preview.state()["overlay"] is None


def test_requests_for_another_host_are_refused(shown: Preview) -> None:
    with serving(shown, 0) as server:
        port = server.server_port
        for host in (f"localhost:{port}", f"127.0.0.1:{port}"):
            assert get(server.url, host)[0] == 200
        for host in ("rebound.example", f"rebound.example:{port}", "127.0.0.1", ""):
            assert get(server.url + "state.json", host)[0] == 421


def test_a_port_in_use_is_named(shown: Preview) -> None:
    with serving(shown, 0) as server:
        again = serving(shown, server.server_port)
        with pytest.raises(InputError, match="give another with --port"):
            again.__enter__()


# the command


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--turn-to", 40), "with --outline SET"),
        (("--outline", "a.ome.tif", "--turn-to", 400), "from -360 to 360"),
        (("--outline", "a.ome.tif"), "a.ome.tif"),
    ],
)
@pytest.mark.usefixtures("in_folder")
def test_a_wrong_outline_is_refused(
    refused: Callable[..., str], options: tuple[object, ...], message: str
) -> None:
    assert message in refused("rig", "preview", "--rig", "sim", "--port", 0, *options)


def test_the_leds_go_out_when_the_command_is_interrupted(tmp_path: Path) -> None:
    for number in range(250):
        frame = np.full((48, 64), number, np.uint8)
        cv2.imwrite(str(tmp_path / f"frame{number:03d}.png"), frame)
    clock = RealClock()
    board = SimulatedBoard(clock)

    def lit() -> list[int]:
        return [led for led in range(4) if board.output(led, clock.now_s()) > 0.5]

    with serve_pty(SimulatedController(board, clock)) as controller:
        (tmp_path / "rig.toml").write_text(
            f'[lights]\nport = "{controller.address}"\n[camera]\nkind = "opencv"\n'
            f'device = "{tmp_path}/frame%03d.png"\nwidth_px = 64\nheight_px = 48\n'
            "frame_rate_hz = 25\nfixed_exposure = true\n"
        )
        command = [sys.executable, "-m", "capture", "rig", "preview", "--port", "0"]
        with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            url = process.stdout.readline().split()[0]
            until_so(lit)
            until_so(lambda: json.loads(get(url + "state.json")[1])["lights"])
            process.send_signal(signal.SIGINT)
            assert process.wait(WAIT_S) == 130
        time.sleep(0.05)
        assert lit() == []


# in a browser


def in_chromium(url: str, tmp_path: Path, *options: str) -> str:
    command = [
        "chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=2500",
        *options, url,  # of two equal options the last one counts
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=3 * WAIT_S, check=True)
    return done.stdout


@pytest.mark.browser
def test_the_page_shows_live_images_in_a_browser(tmp_path: Path) -> None:
    preview = Preview(stale_after_s=60.0)
    with running(preview, SMALL), serving(preview, 0) as server:
        until_so(lambda: has_all_images(preview))
        dom = in_chromium(server.url, tmp_path, "--dump-dom")
        screenshot = tmp_path / "page.png"
        in_chromium(server.url, tmp_path, f"--screenshot={screenshot}", "--window-size=1400,700")
    assert "LED 3, tilt 270°" in dom
    assert dom.count("s old</span>") == 4
    assert 'src="light/0.png?' in dom
    assert "64 x 48 px, 12 bit" in dom
    # The images are grey and bright; the page around them is dark.
    page = cv2.imread(str(screenshot), cv2.IMREAD_GRAYSCALE)
    assert page is not None
    assert np.count_nonzero(page > 110) > 0.1 * page.size


@pytest.mark.browser
def test_the_lights_are_a_cross_with_the_outline_over_each_image(tmp_path: Path) -> None:
    shown = preview_of_age(0.1)
    line = np.array([(8, 8), (55, 8), (55, 40), (8, 40)], np.float32)
    shown.guide("rock-1: turn to 40 degrees", Outline(64, 48, (line,)).svg())
    shown.show_measurement("turn it by 3 anticlockwise")
    with serving(shown, 0) as server:
        dom = in_chromium(server.url, tmp_path, "--dump-dom", "--window-size=1200,1600")
        screenshot = tmp_path / "page.png"
        in_chromium(server.url, tmp_path, f"--screenshot={screenshot}", "--window-size=1200,1600")
    assert "rock-1: turn to 40 degrees" in dom
    assert "turn it by 3 anticlockwise" in dom
    assert dom.count('src="overlay.svg?1"') == 4
    lefts, tops = (
        [float(value) for value in re.findall(rf"<figure[^>]* {side}: ([\d.]+)(?:%|px)", dom)]
        for side in ("left", "top")
    )
    east, north, west, south = zip(lefts, tops, strict=True)
    assert west[0] == 0.0
    assert north[0] == south[0] == pytest.approx(33.3, abs=0.1)
    assert east[0] == pytest.approx(66.7, abs=0.1)
    assert north[1] == 0.0
    assert east[1] == west[1] == pytest.approx(south[1] / 2, rel=0.01)
    # The outline is yellow, on each image.
    page = cv2.imread(str(screenshot), cv2.IMREAD_COLOR)
    assert page is not None
    yellow = (page[..., 2] > 200) & (page[..., 1] > 170) & (page[..., 0] < 80)
    left, middle, right = (np.count_nonzero(yellow[:, k : k + 400]) for k in (0, 400, 800))
    assert left > 500
    assert right == pytest.approx(left, rel=0.2)
    assert middle > 1.8 * left


@pytest.mark.browser
def test_an_image_that_is_too_old_is_blanked_and_its_age_shown(tmp_path: Path) -> None:
    with serving(preview_of_age(60.0), 0) as server:
        dom = in_chromium(server.url, tmp_path, "--dump-dom")
    assert dom.count('class="stale"') == 4
    assert dom.count("too old") == 4
    ages_s = [float(part.split(">")[-1]) for part in dom.split(" s old</span>")[:-1]]
    assert len(ages_s) == 4
    assert min(ages_s) >= 60.0
    assert dom.count("hidden=") >= 4


@pytest.mark.browser
def test_images_age_and_are_blanked_when_the_server_stops_answering(
    shown: Preview, tmp_path: Path
) -> None:
    answers = iter([shown.state()])

    class AnswersOnce(Preview):
        def state(self) -> dict[str, Any]:
            # Any later request ends without an answer.
            for answer in answers:
                return answer
            raise ConnectionError

        def png(self, light: int) -> bytes | None:
            return shown.png(light)

    with serving(AnswersOnce(), 0) as server:
        # The browser's time runs ahead of the clock, except while a request is open.
        dom = in_chromium(server.url, tmp_path, "--dump-dom", "--virtual-time-budget=15000")
    assert "No answer from ps4rig" in dom
    assert dom.count('class="stale"') == 4
