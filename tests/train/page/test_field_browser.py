"""What is told in the field itself, in a real browser: cue, alarms, first steps, the drill; on
every size of screen.
"""

import itertools

import pytest
from fake_session import AS_INSTRUCTOR, HEADER, FakeSession
from page_visit import BROWSER, Visit, click, until

from ravenjax.robots.raven2 import ROBOT
from ravenjax.train.protocol import PHASES

pytestmark = BROWSER
CONTROLS = """
window.controls = [...document.querySelectorAll("#rj :is(button, input, select, textarea, a[href])")]
  .filter((one) => one.offsetParent && !one.disabled && one.tabIndex >= 0);
window.pressed = new Set();
document.addEventListener("click", (event) => {
  const one = event.target.closest("#rj button, #rj input[type=checkbox], #rj a");
  if (one) pressed.add(one);
  event.preventDefault();
  event.stopImmediatePropagation();
}, { capture: true });
window.words = (one) => (one.ariaLabel ?? one.labels?.[0]?.textContent ?? one.textContent).trim();
controls.map((one) => one.outerHTML);
"""  # noqa: E501
FOCUSED = """(() => {
  const one = document.activeElement;
  return { number: controls.indexOf(one), outlined: getComputedStyle(one).outlineStyle !== "none",
    presses: one.matches("button, a, input[type=checkbox]") };
})()"""
SHOWN = "!document.querySelector({!r}).hidden"
PEDAL_DOWN = "document.querySelector('#pedal').classList.contains('down')"


@pytest.fixture
def fresh(request):
    """A session of the test's own; a parameter changes its header."""
    made = FakeSession(HEADER | getattr(request, "param", {}))
    made.wait()
    yield made
    made.close()


def test_who_is_new_practises_before_the_time_runs_and_meets_a_cue_that_cannot_be_missed(
    browser, session
):
    with Visit(browser, session, "role=operator") as page:  # this browser has no graphics card
        assert "scene=off" in page.url and page.evaluate("document.getElementById('root')") is None
        until(page, SHOWN.format("#coach"))
        assert "Space" in page.inner_text("#coach") and "lift the pedal" in page.inner_text(
            "#coach"
        )
        click(page, "#practise")
        page.keyboard.down("Space")
        until(
            page,
            f"{PEDAL_DOWN} && document.getElementById('pedal-state').textContent === 'practice'",
        )
        page.keyboard.down("KeyD")
        until(page, "document.querySelector('#drill h2 span').textContent === '2 of 5'")
        assert not any(
            one.get("pedal") for one in session.commands
        )  # nothing of it reaches the robot
        assert page.inner_text("#phase") == "ready"
        page.keyboard.up("KeyD")
        page.keyboard.up("Space")
        click(page, "[data-drill=close]")
        page.keyboard.down("Space")
        until(page, "document.getElementById('phase').textContent === 'running'")
        until(
            page, "/L: \\d+ mm .*[ADWSRF]/.test(document.querySelector('#coach > p').textContent)"
        )
        with Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off", 1366) as instructor:
            page.bring_to_front()
            page.keyboard.down("Space")
            click(instructor, "#hazards li:nth-child(1) button")
            until(page, SHOWN.format("#cue-sign"))
            assert page.inner_text("#cue-sign b").startswith("L off") and page.inner_text(
                "#cue-sign span"
            ).startswith("The cue pulls ")
            until(page, "ravenjax.state().loudness > 0")  # on by itself after the first key
            assert (
                instructor.locator("#late-box").is_visible()
                and not page.locator("#late-box").is_visible()
            )
            page.keyboard.up("Space")
            until(page, "document.getElementById('cue-sign').hidden")


def test_an_alarm_says_what_and_what_to_do_and_every_check_has_words(browser, session):
    with Visit(browser, session, "role=operator&scene=off") as page:
        words = page.evaluate("import('/static/alarms.js').then((own) => Object.keys(own.ALARMS))")
        told = [check.name for check in ROBOT.checks.values() if check.action in ("stop", "flag")]
        assert sorted(words) == sorted(told)
        session.event("alarm", check="joint_limit", count=1)
        until(page, SHOWN.format("#alarm-words"))
        assert page.inner_text("#alarm-words em") == "Move your hand back."
        assert page.get_attribute("#alarm-words", "role") == "alert"


@pytest.mark.parametrize(
    ("query", "field"), [(AS_INSTRUCTOR, "#note"), ("role=operator", "#volume")]
)
def test_escape_stops_the_robot_also_from_a_field(browser, fresh, query, field):
    with Visit(browser, fresh, f"{query}&scene=off", 1366) as page:
        if field == "#volume":
            click(page, "#coach .cue-test")
        page.focus(field)
        page.keyboard.press("Escape")
        fresh.heard(type="operator", do="estop")


def test_a_second_finger_restarts_the_robot_while_the_first_holds_the_pedal(browser, fresh):
    context = browser.new_context(viewport={"width": 360, "height": 740}, has_touch=True)
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{fresh.port}/?role=operator&scene=off")
    devtools = context.new_cdp_session(page)
    fingers = []

    def touch(kind, selector):
        x, y, width, height = page.locator(selector).bounding_box().values()
        fingers.append({"x": x + width / 2, "y": y + height / 2, "id": len(fingers)})
        points = fingers if kind == "touchStart" else [fingers[1]]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", "#pedal-state")
    until(page, PEDAL_DOWN)
    fresh._set("phase", PHASES.index("stopped"))
    until(page, SHOWN.format("#banner button"))
    touch("touchStart", "#banner button")
    touch("touchEnd", "#banner button")
    fresh.heard(type="operator", do="restart")
    context.close()


@pytest.mark.parametrize("fresh", [{"contact_units_per_n": 0.01}], indirect=True)
def test_whatever_sounds_is_also_written_where_a_screen_reader_finds_it(browser, fresh):
    with Visit(browser, fresh, "role=operator&scene=off", 1366) as page:
        page.keyboard.down("Space")
        until(page, "document.getElementById('phase').textContent === 'running'")
        fresh.frame["gold/contact"] = (0.0, 0.0, 2.0)
        until(
            page,
            "ravenjax.state().loudness > 0 &&"
            " document.querySelector('#pressing').innerText.includes('2.0 N')",
        )
        assert page.locator("#pressing[role=status]").is_visible()
        fresh.frame["gold/contact"] = (0.0, 0.0, 0.0)
        until(page, "ravenjax.state().loudness === 0 && document.getElementById('pressing').hidden")
        for strength in ("0.2", "1"):
            if not page.locator("#cue-check").is_visible():
                click(page, "#coach .cue-test")
            click(page, f"[data-cue='{strength}']")
            until(
                page, "ravenjax.state().loudness > 0 && !document.getElementById('cue-sign').hidden"
            )
            assert "The cue pulls " in page.inner_text("#cue-sign[role=status]")


@pytest.mark.parametrize(
    ("width", "height"),
    [(360, 640), (360, 740), (820, 1180), (740, 360), (1366, 768), (1920, 1080), (3840, 2160)],
)
def test_on_every_screen_field_pads_and_stop_are_there_and_apart(browser, session, width, height):
    touch = min(width, height) < 900 and width < 1000
    context = browser.new_context(
        viewport={"width": width, "height": height},
        has_touch=touch,
        is_mobile=touch,
        device_scale_factor=1,
    )
    page = context.new_page()
    session.frame["phase"] = PHASES.index("ready")
    page.goto(f"http://127.0.0.1:{session.port}/?role=operator")
    until(page, "window.ravenjax.state && window.ravenjax.state().frames > 3")
    until(page, SHOWN.format("#coach"))
    shown = ["#pedal", "#estop", "#scope", ".pad[data-arm=gold]", ".pad[data-arm=green]", "#coach"]
    boxes = {name: page.locator(name).bounding_box() for name in shown}
    # Why the robot does not move is said over the field, never under the card.
    assert page.inner_text("#why").startswith("Hold ")
    assert not _overlap(page.locator("#why").bounding_box(), boxes["#coach"])
    size = float(page.evaluate("parseFloat(getComputedStyle(rj).fontSize)"))
    assert size == pytest.approx(13 * max(1.0, min(width / 1920, height / 1080)), abs=0.1)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for name, box in boxes.items():
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= width, name
        assert box["y"] >= 0 and box["y"] + box["height"] <= height + 1, name
    assert min(boxes["#scope"]["width"], boxes["#scope"]["height"]) > 0.3 * min(width, height)
    for one, other in itertools.combinations(boxes, 2):
        assert not _overlap(boxes[one], boxes[other]), (one, other)
    if touch:
        sizes = page.evaluate(
            "[...document.querySelectorAll('#pedal, #estop, .lift, .grasp button')].filter((one) =>"
            " one.offsetParent).map((one) => Math.min(one.offsetWidth, one.offsetHeight))"
        )
        assert min(sizes) >= 24  # WCAG 2.2, success criterion 2.5.8
    context.close()


def _overlap(a, b):
    return all(
        a[x] < b[x] + b[size] - 1 and b[x] < a[x] + a[size] - 1
        for x, size in (("x", "width"), ("y", "height"))
    )


def test_the_goal_is_drawn_from_two_sides(browser, session):
    assert HEADER["task"]["targets"][0]["arm"] == "gold"
    with Visit(browser, session, "role=operator&scene=off", 1366) as page:
        until(page, "document.getElementById('distance').textContent.endsWith('mm away')")
        halves = page.evaluate("""(() => {
            const c = document.getElementById('scope');
            const beside = c.clientWidth > c.clientHeight;
            return [0, 1].map((i) => {
              const [w, h] = beside ? [c.width / 2, c.height] : [c.width, c.height / 2];
              const d = c.getContext('2d').getImageData(beside ? i * w : 0, beside ? 0 : i * h, w, h).data;
              let pink = 0;
              for (let k = 0; k < d.length; k += 4) pink += d[k] > 200 && d[k + 1] < 140 && d[k + 2] > 180;
              return pink;
            });
        })()""")  # noqa: E501
        assert min(halves) > 30


@pytest.mark.parametrize("role", ["role=operator", AS_INSTRUCTOR])
def test_every_control_is_reached_by_tab_outlined_named_and_pressed_by_enter(browser, fresh, role):
    with Visit(browser, fresh, f"{role}&scene=off", 1366) as page:
        until(page, "window.ravenjax.state().frames > 3")
        controls = page.evaluate(CONTROLS)
        assert len(controls) >= 14
        outlined = set()
        for _ in range(2 * len(controls) + 10):  # summaries and lists that scroll are reached, too
            page.keyboard.press("Tab")
            focused = page.evaluate(FOCUSED)
            if focused["outlined"]:
                outlined.add(focused["number"])
            if focused["presses"]:
                page.keyboard.press("Enter")
        assert [one for number, one in enumerate(controls) if number not in outlined] == []
        bad = "!words(one) || (one.matches('button, input[type=checkbox]') && !pressed.has(one))"
        assert page.evaluate(f"controls.filter((one) => {bad}).map((one) => one.outerHTML)") == []
