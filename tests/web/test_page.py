#!/usr/bin/env python3
"""Opens the web page in headless Chromium and plays: run by scripts/test --web.

usage: test_page.py CALE TRACE PAGE ROMS WORK [TEST...]

CALE is the program, whose `export --web` makes the sites; TRACE plays the same in the native environment; PAGE is the
built page; ROMS a folder of ROM files; sites and screenshots are left in WORK.
"""
import base64
import functools
import http.server
import json
import math
import pathlib
import re
import subprocess
import sys
import threading
import time
import unittest

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import WebDriverWait

ROOT = pathlib.Path(__file__).resolve().parents[2]
CALE, TRACE, PAGE, ROMS, WORK = (pathlib.Path(argument).resolve() for argument in sys.argv[1:6])
STEPS = 1000
TOLERANCE = 1e-5
MOST_BYTES = 3_000_000
LEAST_FRAMES_PER_SECOND = 60
MOST_SECONDS_TO_FIRST_FRAME = 2
DESKTOP, PHONE = (1280, 1180), (390, 844)

# The page's own module, with a session of its own, plays the actions of a trace and says what came of them. The
# CRC-32 is computed here, so that pixels are compared and nothing that the module says of them.
PLAY = """
const [rom, policyName, changes, seed, trace, done] = arguments;
(async () => {
    const { openSession, fetchBytes } = await import('./engine.mjs');
    const table = Uint32Array.from({ length: 256 }, (_, byte) => {
        for (let bit = 0; bit < 8; ++bit) byte = (byte >>> 1) ^ (byte & 1 ? 0xEDB88320 : 0);
        return byte;
    });
    const crc = (bytes, skip) => {
        let rest = ~0;
        for (let i = 0; i < bytes.length; ++i)
            if (!skip || i % 4 !== 3) rest = (rest >>> 8) ^ table[(rest ^ bytes[i]) & 255];
        return ~rest >>> 0;
    };
    const session = await openSession();
    session.loadPolicy(await fetchBytes('policy.safetensors'), policyName);
    session.insertRom(Uint8Array.from(atob(rom), (c) => c.charCodeAt(0)));
    session.start(changes, seed);
    const played = [];
    let milliseconds = 0, frames = 0;
    for (const [r, theta, fire] of trace) {
        const begun = performance.now();
        const moment = session.stepByHand(r, theta, fire);
        milliseconds += performance.now() - begun;
        frames += session.frameCount();
        const { radius, theta: angle, fire: button, action } = moment.decision;
        played.push({
            output: Array.from(session.output()), stick: [radius, angle, button], action,
            reward: moment.reward, lives: moment.lives, over: moment.over,
            screen: crc(session.screen(session.frameCount() - 1), true), observation: crc(session.observation()),
        });
    }
    session.delete();
    done({ played, framesPerSecond: frames / milliseconds * 1000 });
})().catch((error) => done({ error: String(error.message ?? error) }));
"""

# A file dropped on the page, and the milliseconds until its game is seen.
DROP = """
const [name, content, done] = arguments;
const transfer = new DataTransfer();
transfer.items.add(new File([Uint8Array.from(atob(content), (c) => c.charCodeAt(0))], name));
const begun = performance.now();
document.getElementById('drop').dispatchEvent(new DragEvent('drop', { dataTransfer: transfer, bubbles: true, cancelable: true }));
const game = document.getElementById('game');
const look = () => {
    const pixels = game.getContext('2d').getImageData(0, 0, game.width, game.height).data;
    const seen = document.getElementById('invitation').hidden && pixels.some((value, i) => i % 4 !== 3 && value > 0);
    if (seen) return done(performance.now() - begun);
    if (performance.now() - begun > 10000 || !document.getElementById('message').hidden) return done(null);
    requestAnimationFrame(look);
};
look();
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


def base64_of(rom):
    return base64.b64encode((ROMS / f"{rom}.bin").read_bytes()).decode()


def export(policy):
    """The site that a user would make of it."""
    site = WORK / policy
    if not site.exists():
        subprocess.run([CALE, "export", ROOT / f"policies/{policy}.safetensors", "--web", site], check=True,
                       capture_output=True)
    return site


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        handler = functools.partial(Quiet, directory=WORK)
        cls.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=cls.server.serve_forever, daemon=True).start()
        options = webdriver.ChromeOptions()
        options.binary_location = "/usr/bin/chromium"
        for switch in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage"):
            options.add_argument(switch)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        cls.browser = webdriver.Chrome(service=Service("/usr/bin/chromedriver"), options=options)
        cls.browser.set_script_timeout(300)

    @classmethod
    def tearDownClass(cls):
        cls.browser.quit()
        cls.server.shutdown()

    def setUp(self):
        self.expected_errors = False
        self.size(*DESKTOP)

    def tearDown(self):
        self.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
        severe = [entry["message"] for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE" and "favicon.ico" not in entry["message"]]
        if not self.expected_errors:
            self.assertEqual(severe, [])

    # Helpers

    def size(self, width, height, mobile=False):
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 2 if mobile else 1, "mobile": mobile})

    def open(self, policy="road_runner_sac", hash="", path=None):
        self.browser.get("about:blank")
        site = path or export(policy).name
        self.browser.get(f"http://127.0.0.1:{self.server.server_port}/{site}/{hash}")
        self.until(lambda: self.text("invitation-title") != "Loading …" or self.message())

    def until(self, condition, seconds=20):
        return WebDriverWait(self.browser, seconds, poll_frequency=0.05).until(lambda _: condition())

    def find(self, name):
        return self.browser.find_element(By.ID, name)

    def text(self, name):
        return self.browser.execute_script("return document.getElementById(arguments[0])?.textContent ?? ''", name)

    def message(self):
        return self.browser.execute_script("const m = document.getElementById('message'); return m.hidden ? '' : m.textContent")

    def drop(self, rom, name=None):
        return self.browser.execute_async_script(DROP, name or f"{rom}.bin", base64_of(rom))

    def drop_bytes(self, name, content):
        return self.browser.execute_async_script(DROP, name, base64.b64encode(content).decode())

    def steps(self):
        return int(self.text("steps"))

    def plays_on(self):
        before = self.steps()
        self.until(lambda: self.steps() > before + 3)

    def hold_the_stick_left(self):
        """By the mouse, on the dial. The disc's centre is a little left of the canvas's, beside which the button's meter is."""
        dial = self.find("dial")
        width = dial.size["width"]
        ActionChains(self.browser).move_to_element_with_offset(dial, -width // 2 + 4, 0).click_and_hold().perform()

    def compare(self, policy, rom, seed, changes=()):
        words = [str(TRACE), str(ROOT / f"policies/{policy}.safetensors"), str(STEPS), str(seed), *changes]
        native = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
        self.assertEqual(len(native), STEPS)
        self.open(policy)
        result = self.browser.execute_async_script(PLAY, base64_of(rom), policy, "\n".join(changes), seed,
                                                   [step["stick"] for step in native])
        self.assertNotIn("error", result)
        largest = 0
        for number, (here, there) in enumerate(zip(result["played"], native, strict=True)):
            for name in ("reward", "lives", "over", "screen", "observation"):
                self.assertEqual(here[name], there[name], f"{name} of step {number}")
            largest = max(largest, self.action_difference(here, there, number))
        self.assertGreater(sum(step["reward"] != 0 for step in native), 0)
        print(f"\n  {policy}, seed {seed} {' '.join(changes)}: {STEPS} steps, frames and rewards equal, actions within "
              f"{largest:.1e}; {result['framesPerSecond']:.0f} frames/s without drawing")

    def action_difference(self, here, there, number):
        """Of the stick's place and the button; for numbered actions of the outputs, relative to the largest."""
        if there["action"] < 0:
            difference = max(abs(a - b) for a, b in zip(place(here["stick"]), place(there["stick"])))
        else:
            scale = max(1, *map(abs, there["output"]))
            difference = max(abs(a - b) for a, b in zip(here["output"], there["output"], strict=True)) / scale
            best, second = sorted(there["output"])[:-3:-1]
            if best - second > 2 * TOLERANCE * scale:
                self.assertEqual(here["action"], there["action"], f"action of step {number}")
        self.assertLessEqual(difference, TOLERANCE, f"step {number}")
        return difference

    # What is played

    def test_plays_what_the_native_environment_and_policy_play(self):
        self.compare("road_runner_sac", "road_runner", 1)

    def test_plays_the_same_from_pixels(self):
        self.compare("boxing_sac", "boxing", 2)

    def test_plays_the_same_by_numbered_actions(self):
        self.compare("road_runner_joystick", "road_runner", 3)

    def test_plays_the_same_with_every_slider_moved(self):
        self.compare("road_runner_sac", "road_runner", 4, (
            "threshold=0.4", "sticky_probability=0.25", "action_latency=2", "observation_latency=3", "stick_speed=0.2"))

    def test_the_first_frame_is_there_at_once_and_the_game_keeps_its_pace(self):
        self.open()
        milliseconds = self.drop("road_runner")
        self.assertIsNotNone(milliseconds, self.message())
        self.assertLessEqual(milliseconds / 1000, MOST_SECONDS_TO_FIRST_FRAME)
        self.browser.execute_script("const s = document.getElementById('speed'); s.value = '8'; s.dispatchEvent(new Event('change'))")
        rates = []
        for _ in range(3):
            time.sleep(1.2)
            rates.append(int(re.match(r"(\d+) frames/s", self.text("rate"))[1]))
        print(f"\n  first frame {milliseconds:.0f} ms after the drop; at ×8, all drawn, {max(rates)} frames/s")
        self.assertGreaterEqual(max(rates), LEAST_FRAMES_PER_SECOND)

    def test_is_small(self):
        size = sum(file.stat().st_size for file in PAGE.iterdir())
        print(f"\n  page and module: {size / 1e6:.2f} MB")
        self.assertLessEqual(size, MOST_BYTES)
        self.assertFalse([file for file in export("road_runner_sac").iterdir() if file.suffix in (".bin", ".a26")])

    # Who plays

    def test_the_mouse_takes_over_and_gives_back(self):
        self.open()
        self.drop("road_runner")
        self.assertEqual(self.text("player"), "The policy plays")
        self.hold_the_stick_left()
        self.until(lambda: self.text("player") == "You play")
        self.until(lambda: self.text("numbers").startswith("r 1.00 · θ 3.14") or "θ -3.1" in self.text("numbers"))
        self.until(lambda: self.text("numbers").endswith("LEFT"))
        ActionChains(self.browser).release().perform()
        self.until(lambda: self.text("numbers").startswith("r 0.00"))
        self.assertEqual(self.text("player"), "You play")
        self.find("hand").click()
        self.assertEqual(self.text("player"), "The policy plays")
        self.plays_on()

    def test_what_is_still_held_takes_over_again_only_once_it_was_let_go_of(self):
        self.open()
        self.drop("road_runner")
        key = """document.body.dispatchEvent(new KeyboardEvent(arguments[0],
            { code: 'ArrowLeft', key: 'ArrowLeft', repeat: arguments[1], bubbles: true }))"""
        self.browser.execute_script(key, "keydown", False)
        self.until(lambda: self.text("player") == "You play")
        self.find("hand").click()
        self.browser.execute_script(key, "keydown", True)
        self.assertEqual(self.text("player"), "The policy plays", "though the key is still held")
        self.browser.execute_script(key, "keyup", False)
        self.browser.execute_script(key, "keydown", False)
        self.assertEqual(self.text("player"), "You play")
        self.browser.execute_script(key, "keyup", False)
        # The same of the mouse on the dial.
        self.hold_the_stick_left()
        self.until(lambda: self.text("numbers").endswith("LEFT"))
        self.browser.execute_script("document.getElementById('hand').click()")
        ActionChains(self.browser).move_by_offset(3, 3).perform()
        self.plays_on()
        self.assertEqual(self.text("player"), "The policy plays", "though the button is still held")
        ActionChains(self.browser).release().perform()

    def test_the_button_for_fire_works_without_a_pointer(self):
        self.open()
        self.drop("road_runner")
        self.note_fires()
        self.find("fire").send_keys(Keys.ENTER)
        self.until(lambda: self.text("player") == "You play")
        self.until(lambda: self.browser.execute_script("return fires.includes(true) && !fires.at(-1)"))

    def test_a_key_that_is_tapped_between_two_decisions_counts(self):
        self.open()
        self.drop("road_runner")
        self.note_fires()
        self.browser.execute_script("""
            for (const type of ['keydown', 'keyup'])
                document.body.dispatchEvent(new KeyboardEvent(type, { code: 'Space', key: ' ', bubbles: true }));""")
        self.until(lambda: self.text("player") == "You play")
        self.until(lambda: self.browser.execute_script("return fires.includes(true) && !fires.at(-1)"))

    def note_fires(self):
        """From now on the page's `fires` has for each change of the numbers whether they said that fire is pressed."""
        self.browser.execute_script("""
            const numbers = document.getElementById('numbers');
            window.fires = [];
            new MutationObserver(() => fires.push(numbers.textContent.includes('fire 1.00')))
                .observe(numbers, { childList: true, characterData: true, subtree: true });""")

    def test_a_hand_is_seen_while_the_game_waits(self):
        self.open()
        self.drop("road_runner")
        self.find("pause").click()
        self.hold_the_stick_left()
        self.until(lambda: self.text("numbers").startswith("r 1.00"))
        self.assertEqual(self.text("player"), "You play")
        ActionChains(self.browser).release().perform()
        self.until(lambda: self.text("numbers").startswith("r 0.00"))

    def test_a_gamepad_takes_over_and_gives_back(self):
        self.open()
        self.drop("road_runner")
        self.assertIn("No gamepad is connected", self.text("gamepad"))
        self.browser.execute_script("""
            const button = (pressed) => ({ pressed, value: Number(pressed), touched: pressed });
            window.pad = { id: 'Synthetic stick', connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => button(false)) };
            window.press = (number, down) => { pad.buttons[number] = button(down); };
            navigator.getGamepads = () => [null, pad];""")
        self.until(lambda: "Synthetic stick" in self.text("gamepad"))
        self.assertEqual(self.text("player"), "The policy plays")
        self.browser.execute_script("pad.axes = [0.6, -0.6, 0, 0]; press(0, true)")
        self.until(lambda: self.text("player") == "You play")
        self.until(lambda: self.text("numbers").endswith("UPRIGHTFIRE"))
        radius, theta = re.match(r"r (\S+) · θ (\S+)", self.text("numbers")).groups()
        self.assertAlmostEqual(float(radius), (0.6 * 2 ** 0.5 - 0.15) / 0.85, delta=0.011)
        self.assertEqual(theta, "0.79")
        self.browser.execute_script("press(9, true)")
        self.until(lambda: self.text("player") == "The policy plays")
        self.plays_on()
        self.assertEqual(self.text("player"), "The policy plays", "though the stick is still pushed")
        self.browser.execute_script("pad.axes = [0, 0, 0, 0]; press(0, false); press(9, false)")
        self.plays_on()
        self.browser.execute_script("pad.axes = [0.6, -0.6, 0, 0]")
        self.until(lambda: self.text("player") == "You play")
        # A key has the joystick while it is held, and then the stick that was never let go of.
        ActionChains(self.browser).key_down(Keys.ARROW_DOWN).perform()
        self.until(lambda: self.text("numbers").endswith("DOWN"))
        ActionChains(self.browser).key_up(Keys.ARROW_DOWN).perform()
        self.until(lambda: self.text("numbers").endswith("UPRIGHT"))
        # The space bar fires, and leaves the stick to the gamepad.
        ActionChains(self.browser).key_down(Keys.SPACE).perform()
        self.until(lambda: self.text("numbers").endswith("UPRIGHTFIRE"))
        ActionChains(self.browser).key_up(Keys.SPACE).perform()
        self.until(lambda: self.text("numbers").endswith("UPRIGHT"))
        self.browser.execute_script("pad.axes = [0, 0, 0, 0]; press(9, true)")
        self.until(lambda: self.text("player") == "The policy plays")
        self.plays_on()

    def test_keys_and_a_finger_take_over(self):
        self.open()
        self.drop("road_runner")
        ActionChains(self.browser).key_down(Keys.ARROW_DOWN).perform()
        self.until(lambda: self.text("numbers").endswith("DOWN") and self.text("numbers").startswith("r 1.00"))
        self.assertEqual(self.text("player"), "You play")
        ActionChains(self.browser).key_down("s").key_up(Keys.ARROW_DOWN).perform()  # of two keys one is enough
        self.plays_on()
        self.assertRegex(self.text("numbers"), "DOWN$")
        ActionChains(self.browser).key_up("s").perform()
        self.until(lambda: self.text("numbers").startswith("r 0.00"))
        ActionChains(self.browser).send_keys("g").perform()
        self.assertEqual(self.text("player"), "The policy plays")
        self.size(*PHONE, mobile=True)
        box = self.browser.execute_script("""
            const dial = document.getElementById('dial');
            dial.scrollIntoView({ block: 'center' });
            const { x, y, width, height } = dial.getBoundingClientRect();
            return { x, y, width, height };""")
        touch = {"x": box["x"] + 6, "y": box["y"] + box["height"] / 2}
        self.browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [touch]})
        self.until(lambda: self.text("numbers").endswith("LEFT") and self.text("player") == "You play")
        self.browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        self.until(lambda: self.text("numbers").startswith("r 0.00"))

    def test_it_can_be_paused_and_played_step_by_step(self):
        self.open()
        self.drop("road_runner")
        self.plays_on()
        self.find("pause").click()
        before = self.steps()
        self.find("step").click()
        self.find("step").click()
        self.assertEqual(self.steps(), before + 2)
        time.sleep(0.3)
        self.assertEqual(self.steps(), before + 2)
        self.find("pause").click()
        self.plays_on()

    # Settings

    def test_a_link_carries_the_settings(self):
        self.open(hash="#seed=3&speed=2&threshold=0.7&action_latency=4")
        value = lambda name: self.find(name).get_attribute("value")
        self.assertEqual([value(name) for name in ("seed", "speed", "slider-threshold", "slider-action_latency")],
                         ["3", "2", "0.7", "4"])
        self.drop("road_runner")
        self.plays_on()
        self.find("slider-stick_speed").send_keys(Keys.ARROW_LEFT)
        self.until(lambda: "stick_speed=0.5" in self.browser.current_url)
        self.assertIn("seed=3&speed=2&threshold=0.7&action_latency=4", self.browser.current_url)
        self.plays_on()
        self.find("as-trained").click()
        self.assertTrue(self.browser.current_url.endswith("#seed=3&speed=2"), self.browser.current_url)

    def test_an_impossible_setting_gets_its_sentence(self):
        self.open(hash="#threshold=7")
        self.drop("road_runner")
        self.assertIn("These settings cannot be played: threshold must be 0 to 1, not '7'", self.message())

    def test_an_impossible_link_leaves_the_game_as_it_is(self):
        self.open(hash="#threshold=0.7")
        self.drop("road_runner")
        self.plays_on()
        self.browser.execute_script("location.hash = '#speed=4&threshold=abc'")
        self.until(lambda: "cannot be played" in self.message())
        self.assertEqual(self.find("slider-threshold").get_attribute("value"), "0.7")
        self.assertEqual(self.find("speed").get_attribute("value"), "1")
        self.assertTrue(self.browser.current_url.endswith("#seed=1&threshold=0.7"), self.browser.current_url)
        self.find("pause").click()
        self.plays_on()

    def test_a_slider_that_was_moved_by_the_mouse_leaves_the_arrows_to_the_stick(self):
        self.open()
        self.drop("road_runner")
        self.plays_on()
        slider = self.find("slider-threshold")
        ActionChains(self.browser).move_to_element_with_offset(slider, slider.size["width"] // 4, 0).click().perform()
        self.until(lambda: "threshold=" in self.browser.current_url)
        before = self.browser.current_url
        self.browser.switch_to.active_element.send_keys(Keys.ARROW_LEFT)
        self.until(lambda: self.find("player").text == "You play")
        self.assertEqual(self.browser.current_url, before)

    def test_the_dial_takes_over_only_where_there_is_a_game(self):
        self.open()
        self.find("dial").click()
        self.assertEqual(self.find("player").text, "The policy plays")

    def test_a_link_sets_no_more_than_the_sliders(self):
        self.open()
        read = self.browser.execute_async_script("""
            const done = arguments[0];
            import('./options.mjs').then(({ fromHash }) => done(
                [fromHash('#seed=').seed, ...fromHash('#threshold=0.5%0Aframe_stack=8&stick_speed=0.2').settings]));""")
        self.assertEqual(read, [1, ["stick_speed", "0.2"]])

    # What may be wrong

    def test_a_wrong_rom_is_told_which_game_it_is(self):
        self.open()
        self.assertIsNone(self.drop("breakout", name="mystery.bin"))
        self.assertIn("mystery.bin: this is the ROM of Breakout, but the policy plays RoadRunner", self.message())
        self.drop_bytes("noise.bin", b"noise" * 100)
        self.assertRegex(self.message(), r"noise\.bin: this file \(MD5 [0-9a-f]{32}\) is no ROM that ALE knows")
        self.drop("road_runner")
        self.assertEqual(self.message(), "")
        self.plays_on()

    def test_a_damaged_policy_gets_its_sentence(self):
        self.expected_errors = True
        site = WORK / "damaged"
        if not site.exists():
            subprocess.run(["cp", "-r", export("road_runner_sac"), site], check=True)
        policy = bytearray((export("road_runner_sac") / "policy.safetensors").read_bytes())
        policy[-100] ^= 1
        (site / "policy.safetensors").write_bytes(policy)
        self.open(path="damaged")
        self.assertRegex(self.message(), r"^'policy\.safetensors' cannot be used: .*checksum")
        self.drop_bytes("cut.safetensors", bytes(policy[:5000]))
        self.assertRegex(self.message(), r"'cut\.safetensors' cannot be used: ")
        (site / "policy.safetensors").unlink()
        self.open(path="damaged")
        self.assertIn("policy.safetensors could not be read: the server answers 404", self.message())

    def test_a_policy_can_be_dropped_too(self):
        self.open()
        self.drop_bytes("boxing.safetensors", (ROOT / "policies/boxing_sac.safetensors").read_bytes())
        self.until(lambda: self.text("title").startswith("Boxing"))
        self.drop("boxing")
        self.plays_on()

    def test_a_browser_without_simd_or_exceptions_gets_a_sentence(self):
        for lacking, accepted in (("SIMD", "[]"), ("exceptions", "[31]")):  # by the sizes of the modules that are tried
            script = self.browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {
                "source": f"WebAssembly.validate = (module) => {accepted}.includes(module.length)"})
            try:
                self.open()
                self.assertIn(f"This browser’s WebAssembly has no {lacking}", self.message())
            finally:
                self.browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)

    def test_opened_as_a_file_it_says_that_it_needs_a_server(self):
        self.expected_errors = True
        self.browser.get("about:blank")
        self.browser.get(f"file://{export('road_runner_sac')}/index.html")
        self.until(lambda: self.find("needs-server").is_displayed())

    # cale report --web

    def open_report(self):
        report = WORK / "report"
        if not report.exists():
            subprocess.run([CALE, "report", ROOT / "docs/results/ram_gates/runs", "--web", "--group-by", "agent", "-o", report, "--resamples", "200"],
                           check=True, capture_output=True)
        self.browser.get(f"http://127.0.0.1:{self.server.server_port}/report/report.html")

    def count(self, script):
        return self.browser.execute_script(f"return {script}.length")

    def test_a_report_shows_the_values_of_its_curves(self):
        self.open_report()
        line = self.browser.execute_script("""
            const line = document.querySelector('#game_curves ~ .card svg polyline[data-samples]');
            line.scrollIntoView({ block: 'center' });
            const point = line.getAttribute('points').split(' ')[5].split(',');
            const at = new DOMPoint(...point).matrixTransform(line.getScreenCTM());
            return { x: at.x, y: at.y, sample: line.dataset.samples.split(' ')[5].split(',').map(Number) };""")
        self.browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": line["x"], "y": line["y"]})
        shown = self.browser.execute_script("return document.querySelector('.value').textContent")
        step, score = line["sample"][:2]
        self.assertIn(f"at {step:,.0f}: ", shown)
        self.assertAlmostEqual(float(re.search(r": (-?[\d,.]+)", shown.split("\n")[1])[1].replace(",", "")), score,
                               delta=abs(score) * 1e-3 + 1e-3)

    def test_a_report_hides_groups_and_games(self):
        self.open_report()
        visible = "[...document.querySelectorAll('[data-series=\"0\"]')].filter((e) => getComputedStyle(e).display !== 'none')"
        self.assertGreater(self.count(visible), 5)
        group = self.browser.find_element(By.CSS_SELECTOR, ".tools button")
        group.click()
        self.assertEqual(self.count(visible), 0)
        self.assertEqual(group.get_attribute("aria-pressed"), "false")
        group.click()
        rows = "[...document.querySelectorAll('#game_scores ~ .card tbody')[0].rows].filter((r) => r.offsetHeight > 0)"
        before = self.count(rows)
        self.assertGreater(before, 1)
        game = self.browser.execute_script(f"return {rows}[1].cells[0].textContent")
        self.browser.find_element(By.CSS_SELECTOR, ".tools input").send_keys(game.lower())
        self.assertEqual(self.count(rows), 1)
        panels = ("new Set([...document.querySelector('#game_curves ~ .card svg').querySelectorAll('[data-panel]')]"
                  ".filter((e) => e.style.display !== 'none').map((e) => e.dataset.panel))")
        self.assertEqual(self.browser.execute_script(f"return {panels}.size"), 1)
        self.browser.execute_script("document.getElementById('game_curves').scrollIntoView()")
        self.browser.save_screenshot(str(WORK / "screenshots/report.png"))

    # How it looks

    def test_screenshots(self):
        folder = WORK / "screenshots"
        for policy, rom in (("road_runner_sac", "road_runner"), ("kung_fu_master_rainbow", "kung_fu_master")):
            for device, (width, height), mobile in (("desktop", DESKTOP, False), ("phone", PHONE, True)):
                self.size(width, height, mobile)
                self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [
                    {"name": "prefers-color-scheme", "value": "light"}]})
                self.open(policy, "#seed=1&speed=8" + ("&stick_speed=0.2" if policy == "road_runner_sac" else ""))
                self.assertIsNotNone(self.drop(rom), self.message())
                self.until(lambda: self.steps() > 150, 60)
                self.find("pause").click()
                for theme in ("light", "dark"):
                    self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [
                        {"name": "prefers-color-scheme", "value": theme}]})
                    self.find("step").click()
                    whole, across = self.browser.execute_script(
                        "const e = document.documentElement; return [e.scrollHeight, e.scrollWidth]")
                    self.assertLessEqual(across, width, f"{device} scrolls sideways")
                    self.size(width, whole, mobile)
                    time.sleep(0.3)
                    self.find("step").click()
                    self.browser.save_screenshot(str(folder / f"{rom}_{device}_{theme}.png"))
                    self.size(width, height, mobile)


def place(stick):
    """Where (r, theta, fire) is: theta alone means nothing near the centre."""
    radius, theta, fire = stick
    return radius * math.cos(theta), radius * math.sin(theta), fire


if __name__ == "__main__":
    (WORK / "screenshots").mkdir(parents=True, exist_ok=True)
    suite = (unittest.defaultTestLoader.loadTestsFromNames([f"Page.{name}" for name in sys.argv[6:]], sys.modules["__main__"])
             if sys.argv[6:] else unittest.defaultTestLoader.loadTestsFromTestCase(Page))
    result = unittest.TextTestRunner(verbosity=2, stream=sys.stdout).run(suite)
    failed = len(result.failures) + len(result.errors)
    print(f"{result.testsRun - failed} passed, {failed} failed")
    sys.exit(failed > 0)
