"""Keys that nothing would read, or that would only make copies of one run: each is refused with
what to write.
"""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from ravenjax.campaign import lint, loading
from ravenjax.campaign.faults import design
from ravenjax.errors import UserError
from ravenjax.robots.raven2 import ROBOT

HEAD = """
[campaign]
name = "x"
duration_s = 2.0
seed = 1
"""

DAC = """
[[group]]
name = "dac"
DESIGN
[[group.fault]]
site = "usb_out"
channel = CHANNEL
effect = EFFECT
value = VALUE
start_ms = START
MORE
"""

PLAIN = {
    "DESIGN": "",
    "CHANNEL": '"shoulder"',
    "EFFECT": '"overwrite"',
    "VALUE": "[100, 200]",
    "START": "1000",
    "MORE": "",
}


def dac(**words: str) -> str:
    text = HEAD + DAC
    for name, plain in PLAIN.items():
        text = text.replace(name, words.get(name.lower(), plain))
    return text


def network(keys: str) -> str:
    return (
        f"{HEAD}[[group]]\nname = 'net'\n[[group.fault]]\nsite = 'network'\nstart_ms ="
        f" 500\n{keys}\n"
    )


def load(text: str) -> Any:
    return loading.from_dict(tomllib.loads(text))


def refusal(text: str) -> str:
    with pytest.raises(UserError) as error:
        load(text)
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (  # one draw where many were meant
            dac(value="{ uniform = [-100, 100] }"),
            [
                (
                    "group[0].fault[0].value: uniform = [-100, 100] is drawn from once, for the"
                    " group makes one run"
                ),
                'write design = "random" (or "lhs", "sobol") and runs = 100 in the group',
            ],
        ),
        (
            dac(start="{ choice = [10, 20] }", value="5"),
            ["fault[0].start_ms: choice = [10, 20] is drawn from once"],
        ),
        (
            HEAD
            + "[[group]]\nname = 'robot'\nparameters.plant.friction_scale = { uniform = [0.5, 2] }",
            ["group[0].parameters.plant.friction_scale: uniform = [0.5, 2] is drawn from once"],
        ),
        (
            HEAD + "[parameters]\nplant.friction_scale = { uniform = [0.5, 2] }\n[[group]]\nname ="
            " 'robot'",
            [
                "parameters.plant.friction_scale: uniform = [0.5, 2] is drawn from once, for the"
                " campaign makes one run"
            ],
        ),
        (  # values of an effect that takes none
            network("effect = 'drop'\nvalue = [1, 2, 3]"),
            ["group[0].fault[0].value: effect 'drop' takes no value: remove the key"],
        ),
        (
            dac(effect='"stuck"', value="3"),
            ["fault[0].value: effect 'stuck' takes no value: remove the key"],
        ),
        (
            dac(effect='["stuck", "overwrite"]'),
            [
                "fault[0].effect: effect 'stuck' takes no value, and a grid would run it once for"
                " each value, all alike"
            ],
        ),
        (
            network("effect = 'drop'\nchannel = ['lag', 'delay']"),
            ["fault[0].channel: effect 'drop' acts on 'lost' by itself: remove the key"],
        ),
        (
            network("effect = ['drop', 'overwrite']\nchannel = ['lag', 'delay']\nvalue = 1"),
            [
                "fault[0].effect: effect 'drop' acts on 'lost' by itself, and a grid would run it"
                " once for each channel"
            ],
        ),
        (
            dac(more="period_ms = 5"),
            ["fault[0].period_ms: effect 'overwrite' has no period: remove the key"],
        ),
        (  # the same twice
            dac(channel='["shoulder", "elbow", "shoulder"]'),
            [
                "fault[0].channel: got 'shoulder' twice: its runs would be identical. Write each"
                " value once"
            ],
        ),
        (dac(value="[1, 2, 1.0, 1]"), ["fault[0].value: got 1 3 times", "write { choice = [..] }"]),
        (
            HEAD + "[cross]\nplant.mass_scale = [1, 1]\n[[group]]\nname = 'a'",
            ["cross.plant.mass_scale: got 1 twice"],
        ),
        (
            HEAD + "[haptics]\nthreshold_mm = [3, 3]\n[[group]]\nname = 'a'",
            ["haptics: two of the haptic sets are the same"],
        ),
        (
            HEAD
            + "[[detector]]\nname = 'd'\nkind = 'tip_error'\nthreshold = [1, 1]\n[[group]]\nname"
            " = 'a'",
            ["detector[0].threshold: got 1.0 2 times, expected each value once"],
        ),
        (
            HEAD + "[[detector]]\nname = 'd'\nkind = 'tip_error'\n"
            "[[detector]]\nname = 'd'\nkind = 'steps'\n[[group]]\nname = 'a'",
            ["detector[1].name: got 'd' twice, expected a name of its own for each detector"],
        ),
        (  # a sample of nothing
            dac(design='design = "sobol"\nruns = 64', value="5"),
            ["group[0].runs: the 64 runs would be identical: nothing in the group is drawn"],
        ),
        (  # one number by two names
            HEAD
            + "[parameters]\nplant.friction_scale = 2\n[[group]]\nname = 'a'\n[[group]]\nname ="
            " 'b'\n"
            "parameters.plant.gold.friction_scale = 0.7",
            [
                "group[1].parameters.plant.gold.friction_scale: names numbers that"
                " plant.friction_scale names, too"
            ],
        ),
        (
            HEAD + "[parameters]\nplant.mass_scale = 2\n[cross]\nplant.mass_scale = [1,"
            " 2]\n[[group]]\nname = 'a'",
            [
                "cross.plant.mass_scale: stands in parameters, too, where cross would replace it:"
                " remove one of the two"
            ],
        ),
        (  # onsets after the end
            dac(design='design = "random"\nruns = 9', start="{ uniform = [500, 5000] }"),
            ["fault[0].start_ms: got uniform = [500, 5000], expected at most 1999"],
        ),
        (  # what nothing reads
            HEAD + "[parameters]\noperator.start_grasp = 500\n[[group]]\nname = 'a'",
            [
                "operator.start_grasp: nothing reads it but with console = 'absolute': remove it,"
                " or set that"
            ],
        ),
        (
            HEAD
            + "software = 'fork2015'\n[cross]\ncontrol.overdrive.policy = [0, 1]\n[[group]]\nname"
            " = 'a'",
            ["cross.control.overdrive.policy: nothing reads it but with software = 'raven2'"],
        ),
        (
            HEAD + "software = 'fork2015'\npolicy = 'hard_regulation'\n[[group]]\nname = 'a'",
            [
                "campaign.policy: got 'hard_regulation', but the 2015 fork has no policy: remove"
                " the key"
            ],
        ),
        (
            HEAD + "[[group]]\nname = 'a'\nparameters.control.overdrive.dac_max.grasp2 = 5",
            ["dac_max.grasp2: nothing reads it: the original's check never looks at grasp2"],
        ),
        (
            dac(design='design = "list"') + "[[group.run]]\nfault = [{ value = 5 }]\n" * 2,
            ["group[0].run[1]: the same as run[0]"],
        ),
    ],
)
def test_what_is_refused_and_what_to_write(text: str, parts: list[str]) -> None:
    message = refusal(text)
    for part in parts:
        assert part in message, message


@pytest.mark.parametrize(
    ("text", "runs"),
    [
        (
            dac(design='design = "random"\nruns = 1', value="{ uniform = [-100, 100] }"),
            1,
        ),  # one run, said so
        (dac(design="repeats = 5", value="{ uniform = [-100, 100] }"), 5),
        (dac(channel='"*"', value="{ uniform = [-100, 100] }"), 7),
        (dac(start="[500, 600]", value="{ uniform = [-100, 100] }"), 2),  # a draw for each onset
        (
            dac(value="{ choice = [1, 1, 2] }", design='design = "lhs"\nruns = 6'),
            6,
        ),  # a choice may weigh
        (
            dac(design='design = "zip"', value="[1, 1]", start="[500, 600]"),
            2,
        ),  # side by side, values come again
        (dac(design='design = "lhs"\nruns = 6', effect='["stuck", "overwrite"]'), 6),
        (network("effect = ['drop', 'duplicate']"), 2),
        (network("effect = 'drop'\nchannel = 'lost'"), 1),
        (dac(effect='["periodic", "overwrite"]', more="period_ms = 5"), 4),
        (
            HEAD + "[parameters]\nplant.mass_scale = { uniform = [1, 2] }\n[[group]]\nname ="
            " 'a'\nrepeats = 3",
            3,
        ),
        (
            HEAD + "[parameters]\nplant.mass_scale = { uniform = [1, 2] }\n[[group]]\nname = 'a'\n"
            "[[group]]\nname = 'lib'\nhazards = 'B18'\nstart_ms = 500",
            2,
        ),
    ],
)
def test_what_is_meant_is_taken(text: str, runs: int) -> None:
    assert design.count(load(text)) == runs


def test_a_robot_drawn_anew_for_each_hazard_is_no_slip() -> None:
    config = load(
        HEAD + "[[group]]\nname = 'lib'\nhazards = ['B18', 'K01']\nstart_ms = 500\n"
        "parameters.plant.friction_scale = { uniform = [0.5, 2] }"
    )
    table = design.expand(config)
    assert table["param:plant.friction_scale"].nunique() == len(table) > 1


def test_a_template_of_a_search_draws_by_itself() -> None:
    raw = tomllib.loads(dac(value="{ uniform = [-100, 100] }"))
    assert loading.from_dict(raw, template=True).group[0].fault[0].value


@pytest.mark.parametrize(
    ("one", "other", "both"),
    [
        ("plant.friction_scale", "plant.gold.friction_scale", True),
        ("plant.gold.friction_scale", "plant.green.friction_scale", False),
        ("nominal.kp", "nominal.gold.kp.elbow", True),
        ("nominal.kp.shoulder", "nominal.gold.kp.elbow", False),
        ("haptics.cues.threshold_m", "haptics.cues.1.threshold_m", True),
        ("haptics.cues.0.kp", "haptics.cues.1.kp", False),
        ("plant.mass_scale", "nominal.mass_scale", False),
        ("detectors.shoulder.mpos", "detectors.elbow.mpos", False),
    ],
)
def test_paths_that_share_a_number(one: str, other: str, both: bool) -> None:
    assert lint.overlap(ROBOT, one, other) is lint.overlap(ROBOT, other, one) is both


def test_notices_are_no_errors() -> None:
    config = load(
        HEAD + "[parameters]\nplant.encoder_noise = 2\n[[group]]\nname = 'lib'\nhazards = 'B26'\n"
    )
    assert [
        (key[-1], message.partition(";")[0].partition(",")[0])
        for key, message in lint.notices(config)
    ] == [
        ("plant.encoder_noise", "nothing reads it while campaign.noise is off"),
        ("start_ms", "got uniform = [250"),
    ]
