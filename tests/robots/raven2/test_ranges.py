"""Normal operating ranges are complete."""

from ravenjax.robots.raven2.declaration import ROBOT, SITES


def test_every_channel_that_a_fault_can_strike_has_a_range() -> None:
    expected = {
        (site.name, arm, channel.name): channel.unit
        for site in SITES.values()
        for arm in (ROBOT.arms if site.per_arm else ("",))
        for channel in site.channels
    }
    assert {key: usual.unit for key, usual in ROBOT.ranges.items()} == expected
