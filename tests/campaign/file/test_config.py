"""Campaign files: what is accepted, and that each mistake is told with file, line, key,
expectation and suggestion.
"""

import tomllib

import pytest

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.errors import UserError

GOOD = """\
[campaign]
name = "x"
duration_s = 2.0

[operator]
motion = "reach"

[parameters]
plant.friction_scale = { uniform = [0.5, 2.0] }
"operator.scale" = [0.05, 0.1]

[[group]]
name = "free"

[[group]]
name = "dac"

[[group.fault]]
site = "usb_out"
channel = ["shoulder", "elbow"]
effect = "overwrite"
value = [100, 200]
start_ms = 1000
duration_ms = [10, "end"]
"""


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "c.toml"
        path.write_text(text)
        return path

    return write


def complaint(path, *overrides):
    with pytest.raises(UserError) as error:
        loading.load_campaign(path, overrides)
    return str(error.value)


def test_dump_loads_again(write):
    """The manifest keeps the dumped config: it must mean the same campaign."""
    config = loading.load_campaign(
        write(GOOD), ['group.dac.fault.0.duration_ms={choice = [3, "end"]}']
    )
    again = loading.from_dict(config.model_dump(mode="json"))
    assert design.table_columns(again).equals(design.table_columns(config))


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        (
            'motion = "reach"',
            'motion = "rech"',
            ":6: operator.motion: unknown motion 'rech' | Did you mean 'reach'",
        ),
        (
            'motion = "reach"',
            'motion = "reach"\nfile = "a.csv"',
            "operator | either motion | or file",
        ),
        (
            '"usb_out"',
            '"usbout"',
            ":19: group[1].fault[0].site: unknown fault site 'usbout' | Did you mean 'usb_out'",
        ),
        (
            "value = [100, 200]",
            "value = 99999",
            ":22: | shoulder is a 16-bit number: | got 99999, which would wrap to -31073",
        ),
        (
            "start_ms = 1000",
            'start_ms = 5000\ntrigger = "pedal"',
            "got 5000, expected less than 2000 ms, the length of the run",
        ),
        (
            "duration_s = 2.0",
            "duration_s = 2.0004",
            "got 2.0004 s, expected whole milliseconds, at least 0.001 s, | such as 2",
        ),
        ('"overwrite"', '"bit_flip"', ":22: | index of a bit, 0..15, got 100"),
        (
            "start_ms = 1000",
            'start_ms = 1000\narm = "green"',
            "arm 'green' is not in this campaign",
        ),
        ('"free"', '"dac"', "got name 'dac' twice"),
        (
            'motion = "reach"',
            'file = "a.csv"\nrotation = { blue = [0, 0, 0, 1] }',
            "operator.rotation.blue: got 'blue', expected 'gold' or 'green'",
        ),
        (
            '"free"',
            '"free"\ndesign = "zip"\nparameters."plant.a" = [1, 2, 3]',
            "'zip' needs lists of one length",
        ),
        (
            "[parameters]",
            "[limits]\nelbow_deg = [40, 135]\n[parameters]",
            "limits.elbow_deg[0]: got 40, expected greater than or equal to 45",
        ),
    ],
)
def test_each_mistake_has_its_message(write, old, new, parts):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    message = complaint(path)
    assert message.startswith(f"{path}")
    for part in parts.split(" | "):
        assert part in message, message


@pytest.mark.parametrize(
    "site, channel, value, what",
    [
        ("runlevel", "rl_desired", "9", "rl_desired is a run level: expected 0..3, got 9"),
        ("pins_out", "pins", "{uniform = [0, 300]}", "pins is a byte: expected 0..255, got 300"),
        ("brake", "engaged", "2", "engaged is a truth value"),
    ],
)
def test_a_field_that_is_written_anew_holds_what_it_can(write, site, channel, value, what):
    text = GOOD.replace('"usb_out"', f'"{site}"').replace('["shoulder", "elbow"]', f'"{channel}"')
    message = complaint(write(text.replace("[100, 200]", value)))
    assert what in message and ":22: group[1].fault[0].value" in message
    assert loading.load_campaign(write(text.replace("[100, 200]", "1")))


def test_lists_side_by_side_are_looked_at_pair_by_pair(write):
    """Bit 3 and count 100 each fit their own effect; in a grid they would be crossed."""
    text = GOOD.replace('"overwrite"', '["bit_flip", "overwrite"]').replace(
        "[100, 200]", "[3, 100]"
    )
    assert "index of a bit" in complaint(write(text))
    text = text.replace('name = "dac"', 'name = "dac"\ndesign = "zip"').replace(
        '"operator.scale" = [0.05, 0.1]', ""
    )
    config = loading.load_campaign(write(text))
    assert len(design.table_columns(config)) == 3


def test_too_many_runs(write):
    text = GOOD.replace("[100, 200]", str(list(range(3000)))).replace(
        "= 1000", f"= {list(range(1, 2000))}"
    )
    text = text.replace('"dac"', '"dac"\nrepeats = 100')
    message = complaint(write(text), "campaign.limit=10")
    assert "group: the groups make" in message and "expected at most 100000000" in message


def test_all_mistakes_are_told_at_once_in_order_of_lines(write):
    text = GOOD.replace("usb_out", "usb").replace("reach", "rech").replace("overwrite", "over")
    numbers = [int(line.split(":")[1]) for line in complaint(write(text)).splitlines()]
    # The channels and effects of an unknown site say nothing.
    assert numbers == sorted(numbers) and len(numbers) == 2


@pytest.mark.parametrize("name", ["quik.toml", "/nowhere/quik.toml"])
def test_missing_file_is_told_in_one_line_with_the_nearest_name(name):
    message = complaint(name)
    assert (
        message.startswith(f"{name}: no such campaign file; `ravenjax campaigns` lists")
        and "\n" not in message
    )
    assert message.endswith("Did you mean 'quick'?") and len(message) < 200


def test_bundled_campaigns_need_no_suffix(tmp_path, monkeypatch):
    assert loading.load_campaign("quick") == loading.load_campaign("quick.toml")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quick").mkdir()
    assert loading.load_campaign("quick").campaign.name == "quick", (
        "a folder of that name is no campaign"
    )
    (tmp_path / "mine.toml").write_text(GOOD)
    assert loading.load_campaign("mine").campaign.name == "x"


def test_a_byte_order_mark_is_skipped(tmp_path):
    path = tmp_path / "c.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert loading.load_campaign(path).campaign.name == "x"
    path.write_bytes(GOOD.encode("utf-16"))
    assert "Expected a TOML file in UTF-8" in complaint(path)


def test_unknown_parameters(write):
    config = loading.load_campaign(write(GOOD))
    loading.check_parameters(config, ["plant.friction_scale", "operator.scale"])
    with pytest.raises(UserError) as error:
        loading.check_parameters(config, ["plant.friction_scal", "operator.scale"])
    assert (
        ":9: parameters.plant.friction_scale: unknown parameter. Did you mean 'plant.friction_scal'"
        in str(error.value)
    )


def test_overrides(write):
    path = write(GOOD)
    config = loading.load_campaign(
        path,
        [
            "campaign.duration_s=3",
            "operator.motion=circle",
            "group.dac.fault.0.value=[1, 2, 3]",
            "group.1.fault.0.start_ms={uniform = [500, 600]}",
            "parameters.plant.friction_scale=2",
            "haptics.threshold_mm=[2, 3]",
        ],
    )
    assert config.campaign.duration_s == 3.0
    assert config.operator.motion == "circle"
    assert config.group[1].fault[0].value.values == (1, 2, 3)
    assert config.group[1].fault[0].start_ms.kind == "uniform"
    assert config.parameters["plant.friction_scale"].values == (2,)
    assert len(config.haptics.cues()) == 2


@pytest.mark.parametrize(
    "override, parts",
    [
        ("campaign.sed=1", ["--set: campaign.sed: unknown key", "Did you mean 'seed'"]),
        ("campaign.seed", ["--set campaign.seed: expected key.path=value"]),
        ("group.dak.repeats=1", ["got 'dak'", "free, dac", "Did you mean 'dac'"]),
        ("campaign.name.x=1", ["'x' is a value without key 'x'"]),
    ],
)
def test_bad_overrides(write, override, parts):
    message = complaint(write(GOOD), override)
    for part in parts:
        assert part in message, message


def with_section(section: dict) -> CampaignConfig:
    return loading.from_dict({**tomllib.loads(GOOD), **section})


def test_cues_are_the_product_in_si():
    lists = {"threshold_mm": [2, 3], "kp_per_mm": [0.0045, 0.009]}
    cues = with_section({"haptics": lists}).haptics.cues()
    product = [(0.002, 4.5), (0.002, 9.0), (0.003, 4.5), (0.003, 9.0)]
    assert [(round(c.threshold_m, 9), round(c.kp, 9)) for c in cues] == product
    assert all(c.cap == 0.05 and abs(c.kd - 0.09) < 1e-12 for c in cues)
