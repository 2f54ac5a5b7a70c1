"""The page in a real browser: offline, without an error, driven by keys, pads and a gamepad, in
both roles.
"""

from pathlib import Path

import pytest
import waiting
from chromium import ARGUMENTS, CHROMIUM
from fake_session import AS_INSTRUCTOR, HEADER, INSTRUCTOR, FakeSession
from page_visit import BROWSER, Visit, click, until

from ravenjax.robots.raven2 import ROBOT
from ravenjax.store.logs.session import description
from ravenjax.train.protocol import PHASES

pytestmark = BROWSER


def pressed(session, since, wanted):
    """The first input after command number `since` for which `wanted` holds."""
    return waiting.until(
        lambda: next(
            (one for one in session.commands[since:] if one["type"] == "input" and wanted(one)),
            None,
        ),
        "no such input",
    )


@pytest.mark.slow  # not on a machine with a GPU
def test_the_scene_comes_with_everything_in_it_and_asks_nobody_else(chromium, session):
    browser = chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
    with Visit(browser, session, "role=operator&scene=on&quality=low", 800) as page:
        until(page, "[...document.querySelectorAll('#root canvas')].some((one) => one.width > 0)")
        assert (
            page.evaluate("location.search") == "?role=operator&scene=on&quality=low"
        )  # the scene's server stays out of it
        for name in ("closeup", "front"):
            click(page, f"[data-camera={name}]")
        until(page, "ravenjax.theatre?.key && ravenjax.theatre.cloth")
        # set again and again, because a slow page turns the shadows off
        until(page, "(shadows.checked = true) && ravenjax.theatre.key.shadow.map")
        shown = page.evaluate("ravenjax.state().frames")
        until(page, f"ravenjax.state().frames > {shown + 10}")
        assert (
            page.evaluate("getComputedStyle(document.getElementById('rj')).pointerEvents") == "none"
        )
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    browser.close()


def test_a_window_that_is_open_before_the_page_waits_for_it_without_an_error(browser):
    session = FakeSession()
    try:
        visit = Visit(browser, session, "role=operator&scene=off")
        with visit as page:
            # The waiting page and the page itself, at the address of the visitor.
            assert sum("role=operator&scene=off" in url for url in visit.asked) >= 2
            assert page.evaluate("location.search") == "?role=operator&scene=off"
    finally:
        session.close()


def test_keys_drive_both_arms_and_blur_lets_go(browser, session):
    with Visit(browser, session, "role=operator&scene=off") as page:
        at = len(session.commands)
        page.keyboard.down("Space")
        page.keyboard.down("KeyD")
        page.keyboard.down("ArrowUp")
        told = pressed(
            session, at, lambda one: one["arms"].get("green", {}).get("move") == [0.0, 0.0, -1.0]
        )
        assert (
            told["pedal"] is True
            and told["source"] == "keyboard"
            and told["arms"]["gold"]["move"] == [1.0, 0.0, 0.0]
        )
        until(page, "document.querySelector('#runlevel .on').dataset.level === '3'")
        lamps = page.evaluate(
            "[...document.querySelectorAll('#runlevel li')].map((lamp) => lamp.textContent)"
        )
        assert lamps == list(ROBOT.run_levels)
        assert (
            page.evaluate("document.getElementById('pedal-state').textContent") == "down, driving"
        )
        until(page, "window.ravenjax.latency().count > 0")
        sample = page.evaluate("window.ravenjax.latency().samples[0]")
        assert (
            0 < sample["mark"] <= sample["mark_drawn"] and 0 < sample["tip"] <= sample["tip_drawn"]
        )
        at = len(session.commands)
        page.evaluate("window.dispatchEvent(new Event('blur'))")  # the keys are still held down
        told = pressed(session, at, lambda one: not one["pedal"])
        assert all(hand["move"] == [0.0, 0.0, 0.0] for hand in told["arms"].values())


def many(count):
    """A header with so many hazards, in three layers."""
    layers = ("the console", "the control software", "USB boards and motors")
    return HEADER | {
        "hazards": [
            {
                "number": k,
                "hazard": f"B{k:02}",
                "title": "torque stuck" if k % 2 else "packet lost",
                "group": f"all/B{k}",
                "layer": layers[k % 3],
                "right_response": ["stop"],
                "within_s": 2.0,
            }
            for k in range(count)
        ]
    }


def test_an_instructor_finds_keeps_and_plans_hazards(browser, tmp_path):
    session = FakeSession(header=many(60))
    session.wait()
    try:
        with Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off", 1366) as page:
            items = "document.querySelectorAll('#hazards li[data-number]').length"
            assert (
                page.locator("#hazards li.group").count() == 3 and page.evaluate(items) == 0
            )  # folded
            click(page, "#hazards li.group button")
            until(page, f"{items} === 20")
            page.fill("#hazard-search", "b07 torque")
            until(page, f"{items} === 1")
            click(page, "#hazards .star")
            page.fill("#hazard-search", "")
            page.evaluate("document.getElementById('hazard-starred').click()")
            until(page, f"{items} === 1")
            click(page, "#hazards .later")
            page.fill("#hazard-plan-name", "first lesson")
            click(page, "#hazard-keep")
            click(page, "#hazard-clear")
            until(page, "document.querySelectorAll('.hazard-plan li').length === 0")
            page.select_option("#hazard-preset", "first lesson")
            until(page, "document.querySelectorAll('.hazard-plan li').length === 1")
            assert page.evaluate(
                "document.querySelector('#log').getBoundingClientRect().bottom < innerHeight"
            )
            assert "hand" in page.inner_text("#trainee") and "mm/s" in page.inner_text("#trainee")
            page.fill(".hazard-plan input", "0")
            page.evaluate(
                "document.querySelector('.hazard-plan input').dispatchEvent(new Event('change'))"
            )
            page.evaluate("document.querySelector('[data-instructor=start]').click()")
            session.event("started", by="instructor")
            session.frame["phase"] = PHASES.index("running")
            assert session.heard(type="instructor", do="arm")["hazard"] == 7
    finally:
        session.close()


def test_the_next_session_is_asked_for_and_a_refusal_says_why(browser, session):
    with Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off") as page:
        form = "document.getElementById('next').requestSubmit()"
        values = {"participant": "p02", "scenario": "dac_bust", "seed": "5"}
        fill = "([name, value]) => { document.getElementById(`next-${name}`).value = value; }"
        for value in values.items():
            page.evaluate(fill, value)
        page.evaluate(form)
        until(page, "document.querySelector('#next .note').textContent.includes('dac_burst')")
        assert not any(one.get("do") == "next" for one in session.commands)
        page.evaluate(fill, ["scenario", "dac_burst"])
        page.evaluate(form)
        waiting.until(lambda: any(one.get("do") == "next" for one in session.commands))
        (wish,) = [one for one in session.commands if one.get("do") == "next"]
        assert [wish[name] for name in ("participant", "scenario", "seed")] == [
            "p02",
            "dac_burst",
            5,
        ]


def test_the_list_of_sessions_starts_the_next_through_the_instructors_panel(browser, session):
    header = {
        "scenario": {"name": "creep"},
        "participant": "P07",
        "started": "2026-01-02T03:04:05+00:00",
    }
    description.write_session(Path(session.folder).parent / "earlier", header)
    with Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off") as panel:
        listed = panel.context.new_page()
        listed.set_default_timeout(waiting.DEADLINE_MS)
        listed.goto(f"http://127.0.0.1:{session.port}/sessions?instructor_token={INSTRUCTOR}")
        listed.click("[data-participant=P07]")
        listed.click("form button")
        until(
            listed,
            "document.querySelector('[role=status]').textContent.startsWith('The present session is"
            " not over')",
        )
        over = (  # the form is there, as once the session is over
            "{ get: () => false, set: () => {} }"
        )
        panel.evaluate(f"Object.defineProperty(document.getElementById('next'), 'hidden', {over})")
        listed.click("form button")
        session.heard(do="next", participant="P07", scenario="creep")
        until(
            listed,
            "document.querySelector('[role=status]').textContent.startsWith('The session is"
            " being prepared')",
        )


def test_a_hazard_is_armed_felt_and_met(browser, session):
    with (
        Visit(browser, session, "role=operator&scene=off") as operator,
        Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off") as instructor,
    ):
        assert (
            instructor.locator("#hazards li").count() == 2
            and operator.locator("#hazards li").count() == 0
        )
        operator.bring_to_front()
        operator.keyboard.down("Space")
        until(operator, "document.querySelector('#pedal').classList.contains('down')")
        click(instructor, "#hazards li:nth-child(1) button.arm")
        until(instructor, "document.querySelector('#hazards li.struck')")
        until(operator, "ravenjax.state().strength > 0")
        until(operator, "document.querySelector('#alarms .alarm')")
        assert "dac limit" in operator.inner_text("#alarms")
        operator.keyboard.up("Space")
        until(instructor, "document.querySelector('#hazards li.over')")
        assert "avoided" in instructor.inner_text("#hazards")
        assert "hazard" not in operator.inner_text("body").lower()
        drawn = "(() => { const c = document.getElementById('error'); const d = c.getContext('2d')"
        drawn += ".getImageData(0, 0, c.width, c.height).data; return d.some((x) => x > 0); })()"
        assert operator.evaluate(drawn)


def test_virtual_robot_pause_and_stop(browser, session):
    with (
        Visit(browser, session, "role=operator&scene=off") as operator,
        Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off") as instructor,
    ):
        banner = "document.getElementById('banner').innerText"
        operator.bring_to_front()
        operator.keyboard.down("Space")  # the first pedal makes a session run
        until(operator, "!document.querySelector('[data-operator=rehearse]').disabled")
        click(operator, "[data-operator=rehearse]")
        until(operator, f"{banner}.includes('Virtual robot')")
        click(operator, "[data-operator=discard]")
        until(operator, "document.getElementById('view-name').textContent === 'real field'")
        click(instructor, "[data-instructor=pause]")
        until(operator, f"{banner}.includes('Paused')")
        click(instructor, "[data-instructor=resume]")
        until(operator, "document.getElementById('phase').textContent === 'running'")
        box = operator.locator("#estop").bounding_box()
        operator.mouse.move(box["x"] + 20, box["y"] + 10)
        operator.mouse.down()
        until(operator, f"{banner}.includes('Robot stopped')")
        click(operator, "#convert")
        session.heard(type="operator", do="note", text="convert")
        instructor.fill("#note", "asked for help")
        instructor.keyboard.press("Enter")
        session.heard(type="operator", do="note", text="asked for help")
        operator.keyboard.press("Backspace")
        until(operator, "document.getElementById('phase').textContent === 'ready'")
        at = len(session.commands)
        operator.keyboard.press("Escape")
        until(operator, "document.getElementById('phase').textContent === 'stopped'")
        assert any(one.get("do") == "estop" for one in session.commands[at:])


def test_the_debrief_appears_after_the_end(browser, session):
    with (
        Visit(browser, session, "role=operator&scene=off") as operator,
        Visit(browser, session, f"{AS_INSTRUCTOR}&scene=off") as instructor,
    ):
        click(instructor, "[data-instructor=end]")
        assert "Really" in instructor.inner_text("[data-instructor=end]")
        click(instructor, "[data-instructor=end]")
        for page in (operator, instructor):
            until(page, "!document.getElementById('debrief').hidden")
            page.frame_locator("#debrief iframe").locator("h1").wait_for()
            click(page, "#debrief-close")
            until(page, "document.getElementById('banner').innerText.includes('Open the debrief')")
