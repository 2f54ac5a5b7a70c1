"""Implements the command `ravenjax evidence`."""

from pathlib import Path

from evidence import writing
from evidence.record import EvidenceRecord
from ravenjax.cli import console
from ravenjax.errors import UserError
from ravenjax.store.files import hash_file, path_inside


def evidence(
    folders: tuple[Path, ...],
    out: Path | None,
    check: Path | None,
    xlsx: bool,
    credibility: Path | None,
    as_json: bool,
) -> int:
    """Run the command and return its exit code."""
    if check is not None:
        if folders or out is not None or xlsx or credibility is not None:
            what = "it reads result folders and place from the evidence itself"
            raise UserError(f"--check FOLDER stands alone: {what}")
        result = writing.check(check)
        _print_check(check, result, as_json)
        return 1 if result.of_status("broken") else 0
    if not folders:
        what = "Give result folders, or --check with a folder that this command wrote"
        raise UserError(f"of which results? {what}")
    if out is None and len(folders) > 1:
        where = "have no single place; say where with --out FOLDER"
        raise UserError(f"{len(folders)} result folders {where}")
    place = out or path_inside(next(iter(folders)), writing.FOLDER)
    model = None
    if credibility is not None:
        from studies.commands import model_credibility

        model = model_credibility(credibility)
    result = writing.write(folders, place, xlsx, model)
    _print_files(writing.files(place), result, as_json)
    return 0


def _print_files(paths: list[Path], result: EvidenceRecord, as_json: bool) -> None:
    digest = hash_file(paths[-1])
    if as_json:
        plain = result.model_dump(mode="json") | {"files": list(map(str, paths))}
        return console.emit_json(plain | {"record_sha256": digest})
    for sentence in (*result.sentences, result.notice):
        console.print_text(sentence)
    for node in result.of_status("open"):
        console.print_note(f"{node.name} is open: {node.reason}")
    console.print_text("\n".join(f"  wrote    {path}" for path in paths))
    return console.print_text(f"  sha256 of {paths[-1].name}: {digest}")


def _print_check(place: Path, result: EvidenceRecord, as_json: bool) -> None:
    if as_json:
        return console.emit_json(result.model_dump(mode="json"))
    broken = result.of_status("broken")
    files = [node for node in broken if node.item is not None]
    verdict = f"{len(files)} broken" if files else "every checksum holds"
    checked = sum(node.item is not None for node in result.nodes)
    console.print_text(f"{place}: {checked} file{'s' * (checked != 1)} checked, {verdict}")
    for node in files:
        console.print_error(f"{node.name}: {node.reason}")
    if others := [node.name for node in broken if node.item is None]:
        console.print_text(f"what rests on them is broken, too: {', '.join(others)}")
    return None
