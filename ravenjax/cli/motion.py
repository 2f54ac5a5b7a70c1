"""The command `motion` for recorded operators, and the lines that `run` prints about them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ravenjax.cli import console
from ravenjax.cli.console import Overrides, Words

if TYPE_CHECKING:
    from rich.console import Console

    from ravenjax.campaign.file.config import CampaignConfig
    from ravenjax.robots.raven2.campaign.config import RavenConfig
    from ravenjax.store.motion.summary import MotionSummary


def motion(
    file: Path,
    *,
    campaign: str | None = None,
    arms: Words = None,
    overrides: Overrides = None,
    out: Path = Path("results/motions"),
) -> None:
    """Show the content of a recording and the motion that a campaign makes of it.

    Options are those of a campaign, such as --set operator.rate_hz=1000 operator.cutoff_hz=5.
    Without a campaign the whole recording or window is replayed. A file that cannot be replayed
    is drawn if it can be read. It is refused with exit code 2, and the message says what to
    write.

    Parameters
    ----------
    file
        Recorded tip positions: .parquet, .csv, .txt, .tsv, .mcap, .bag or .db3; or a console's packets: .parquet, .pcap or .pcapng.
    campaign
        campaign file whose robot, limits and duration it is for
    arms
        default those that the file holds
    out
        folder of the picture, SVG and PNG
    """  # noqa: E501
    from ravenjax.errors import UserError
    from ravenjax.robots.raven2.campaign import hands
    from ravenjax.store.motion import reach, recording, replay

    config, whole = _config(file, campaign, arms, overrides or [])
    ticks, bounds = None if whole else config.campaign.ticks, hands.operator_bounds(config)
    options, scale = config.operator.options, config.operator.scale
    try:
        one = replay.replay_motion(file, config.campaign.arms, options, ticks, scale, bounds=bounds)
    except UserError:
        # If the file cannot even be read, this raises that error.
        raw = recording.load_recording(file, config.campaign.arms, options)
        courses = replay.motion_courses(raw, reach.reach_poses(raw.poses, bounds).inside, None)
        _draw(file, out, courses, "cannot be replayed as it is")
        raise
    _table(one.summary, console.out)
    begin, end = one.summary.window_s
    courses = replay.motion_courses(one.recording, one.reach.inside, one)
    _draw(file, out, courses, f"{begin:.3f} to {end:.3f} s are replayed")


def show_operator(config: CampaignConfig, to: Console) -> None:
    """Print the motion made of a campaign's recorded operator, if it has one.

    Raises UserError if the recording cannot be used.
    """
    from ravenjax.robots.raven2.campaign import hands
    from ravenjax.robots.raven2.campaign.config import RavenConfig

    if not isinstance(config, RavenConfig) or config.operator.file is None:
        return
    if (one := hands.operator_replay(config)) is not None:
        _table(one.summary, to)


def _config(
    file: Path, campaign: str | None, arms: list[str] | None, overrides: list[str]
) -> tuple[RavenConfig, bool]:
    from ravenjax.campaign import loading
    from ravenjax.robots.raven2.campaign.config import of_raven
    from ravenjax.store.motion import recording

    if campaign is None:
        raw: dict[str, Any] = {
            "campaign": {"name": "motion", "arms": arms or list(recording.arms_in(file))},
            "operator": {"file": str(file)},
            "group": [{"name": "fault_free"}],
        }
        whole = not any(text.startswith("campaign.duration_s") for text in overrides)
        return of_raven(loading.from_dict(raw, overrides=overrides)), whole
    base = of_raven(loading.load_campaign(campaign))
    replaced = [f"operator.file={file.absolute()}"]
    # The options of the generated motion are then dropped.
    if base.operator.file is None:
        replaced = ["operator={}", f"operator.scale={base.operator.scale}", *replaced]
    if arms:
        replaced.append(f"campaign.arms={arms}")
    return of_raven(loading.load_campaign(campaign, [*replaced, *overrides])), False


def _table(summary: MotionSummary, to: Console) -> None:
    from ravenjax.cli import terminal
    from ravenjax.store.motion.summary import table_rows

    to.print(terminal.make_table("Recorded operator", ("what", "how it is"), table_rows(summary)))


def _draw(file: Path, out: Path, courses: Any, title: str) -> None:
    from ravenjax.report.run.motion_plot import motion_plot

    for path in motion_plot(courses, out, file.stem, f"{file.name}: {title}"):
        console.out.print(f"wrote {path}", highlight=False, soft_wrap=True)
