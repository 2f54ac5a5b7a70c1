"""Writes the debrief of a session: a self-contained HTML page."""

from pathlib import Path

from ravenjax import resources
from ravenjax.errors import StoreError
from ravenjax.store.files import write_text
from ravenjax.store.logs.session import description
from ravenjax.train.debrief import dexterity, figures
from ravenjax.train.protocol import Json
from ravenjax.train.recording import reader

FILE = "debrief.html"
CHANNELS = resources.read_tables(__file__, "charts.toml")["channels"]
"""Channels that the debrief reads. All channels of a long recording would need too much memory."""


def write_debrief(folder: Path) -> Path:
    """Write debrief.html into a session's folder and return its path. The function also adds the
    measures of the motion to session.json, for later learning curves. Without a readable recording
    the page has no charts, and tells why. Raises StoreError if the folder has no session.
    """
    # jinja takes a while to import.
    from ravenjax.document import html

    folder = Path(folder)
    header = description.read_session(folder)
    recording = course = None
    reading_error = ""
    try:
        recording = reader.read_recording(folder, CHANNELS)
    except StoreError as error:
        reading_error = str(error)
    if recording is not None and len(recording.rows) > 1:
        course = recording.without_pauses()
        measures = dexterity.measure_dexterity(course)
        header = description.update_session(folder, {"summary": {dexterity.KEY: measures}})
    has_table = (folder / reader.TABLE).exists()
    hazards = reader.read_table(folder)
    # A session that was killed has no table.
    if not has_table and recording is not None:
        hazards = reader.from_recording(recording, header)
    blinded = bool(header.get("blinded"))
    scenario = header.get("scenario") or {}
    limits = {
        "threshold of the cue": header.get("cue_threshold_mm"),
        "limit of hazards": (scenario.get("harm") or {}).get("excursion_mm"),
    }
    limits = {name: mm for name, mm in limits.items() if mm is not None}
    charts: Json = {"hazards": [[] for _ in hazards], "session": []}
    replay, contact = None, {}
    if course is not None:
        charts = {
            "hazards": [figures.hazard_charts(course, row, limits, blinded) for row in hazards],
            "session": figures.session_charts(course, hazards, limits, blinded),
        }
        replay = figures.player_data(course, header, hazards)
        if header.get("contact_units_per_n") is not None:
            contact = dexterity.measure_contact(course)
    attempts = dexterity.read_attempts(folder.absolute())
    environment = html.template_environment("ravenjax.train")
    page = environment.get_template("debrief.html.j2").render(
        header=header,
        scenario={"name": header.get("name") or "session"} | scenario,
        numbers=reader.summarize_hazards(hazards),
        hazards=hazards,
        moments=figures.MOMENTS,
        blinded=blinded,
        has_table=has_table,
        recording=recording,
        trouble=reading_error,
        charts=charts,
        learning=figures.learning_charts(attempts),
        replay=replay,
        contact=contact,
    )
    write_text(folder / FILE, html.with_scopes(page))
    return folder / FILE
