"""Words of a campaign that do not fit together, and parameters that cannot be varied so: each is
refused with what to write.
"""

import tomllib
from typing import Any

import pytest

from ravenjax.campaign import loading
from ravenjax.errors import UserError

HEAD = """
[campaign]
name = "x"
duration_s = 2.0
"""
FAULT = """
[[group]]
name = "dac"
[[group.fault]]
site = "usb_out"
channel = "shoulder"
effect = "overwrite"
value = [100, 200]
start_ms = 1000
"""
NETWORK = "[[group]]\nname = 'net'\n[[group.fault]]\nsite = 'network'\nstart_ms = 500\n"
PLAIN = "[[group]]\nname = 'a'\n"


def load(text: str) -> Any:
    config = loading.from_dict(tomllib.loads(HEAD + text))
    loading.check_parameters(config)
    return config


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            NETWORK + "effect = 'drop'\nvalue = 1",
            "group[0].fault[0].value: effect 'drop' has no value: remove the key",
        ),
        (
            NETWORK + "channel = ['lost', 'lag']\neffect = 'lose'\nvalue = 0.1",
            "fault[0].channel: got 'lag', but effect 'lose' acts on 'lost': remove the key",
        ),
        (FAULT.replace("overwrite", "dely"), "toggle\n"),
        (FAULT.replace("overwrite", "delay"), "fault[0].effect: 'delay' needs site 'network'"),
        (
            "[parameters]\nplant.friction_scale = { together = [1, 2] }\n"
            "plant.mass_scale = { together = [1, 2, 3] }\n" + PLAIN,
            "group[0].parameters: together needs lists of one length, got lengths [2, 3]",
        ),
        (
            "[parameters]\nplant.friction_scale = 2\n[[group]]\nname = 'a'\n[[group]]\nname ="
            " 'b'\nparameters.plant.gold.friction_scale = 0.7",
            "group[1].parameters.plant.gold.friction_scale: names the same numbers as"
            " plant.friction_scale:",
        ),
        (
            "[parameters]\nplant.mass_scale = 2\n[cross]\nplant.mass_scale = [1, 2]\n" + PLAIN,
            "cross.plant.mass_scale: the path is in [parameters], too: remove one of the two",
        ),
        (
            "software = 'fork2015'\npolicy = 'hard_regulation'\n" + PLAIN,
            "campaign.policy: got 'hard_regulation', but software 'fork2015' has no policy",
        ),
    ],
)
def test_what_is_refused_and_what_to_write(text: str, message: str) -> None:
    with pytest.raises(UserError) as error:
        load(text)
    assert message in f"{error.value}\n"
