"""Campaign, search and scenario files with anything wrong anywhere: each is read, or refused by
one clear error.
"""

import json

import pytest
import tiny_campaign as tiny
from mutations import mutant

from ravenjax.campaign import runner
from ravenjax.errors import StoreError, UserError
from ravenjax.store import manifest
from ravenjax.store.logs.session import description
from studies import findings

LONGEST = 20_000
"""Characters of an error."""


def refused(number, folder):
    """Whether the mutant of that number is refused."""
    try:
        mutant(number).read(folder)
    except UserError as error:
        assert 0 < len(str(error)) < LONGEST
        return True
    except Exception as error:
        raise AssertionError(f"mutant {number}: {type(error).__name__}") from error
    return False


def test_three_hundred_mutants_end_in_no_traceback(tmp_path):
    fate = [refused(number, tmp_path) for number in range(300)]
    assert 150 < sum(fate) < 300, "some are refused, and some are still files of their kind"


def test_names_of_groups_that_have_no_text_are_refused(tmp_path):
    # Their names are an integer of 4,400 digits, and a list in many lists.
    assert all(refused(number, tmp_path) for number in (6802, 8766, 11039))


@pytest.mark.slow
@pytest.mark.parametrize("block", range(5))
def test_five_thousand_mutants_end_in_no_traceback(tmp_path, block):
    assert any(refused(number, tmp_path) for number in range(1000 * block, 1000 * (block + 1)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A result folder with a few runs."""
    path = tmp_path_factory.mktemp("result") / "tiny"
    runner.run_campaign(tiny.config(runs=6), path, "simd")
    return path


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("config.group.0", 1.5),
        ("config.group.1.fault", {"a": 1}),
        ("config.group.1.fault.0.effect", 10**30),
        ("config.group.1.fault.0.site", "nowhere"),
        ("config.group.1.name", "\ud800"),
        ("config.outcomes.jump_step_mm", []),
        ("config.campaign.robot", "../../x"),
        ("shape.stages", ["contact"]),
        ("shape.checks.0", ""),
        ("rows", [[0, 10**30]]),
    ],
)
def test_a_tampered_manifest_is_one_error(folder, command_line, path, value):
    record = folder / manifest.FILE
    whole = record.read_text()
    table = tree = json.loads(whole)
    *parents, last = [int(key) if key.isdecimal() else key for key in path.split(".")]
    for key in parents:
        table = table[key]
    table[last] = value
    record.write_text(json.dumps(tree))
    try:
        for words in ("trace --worst 1", "verify --sample 0", "compare", "coverage"):
            name, *more = words.split()
            code, *_ = command_line(name, *[folder] * (1 + (name == "compare")), *more)
            assert code in (0, 1, 2)
    finally:
        record.write_text(whole)


NESTED = ("[" * 100_000, '{"a":' * 100_000)


@pytest.mark.parametrize("text", NESTED, ids=["lists", "tables"])
@pytest.mark.parametrize(
    ("name", "read"),
    [
        (manifest.FILE, manifest.read_manifest),
        (description.FILE, description.read_session),
        (findings.JSON, findings.read),
    ],
)
def test_json_nested_without_end_is_one_error(tmp_path, name, read, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(StoreError, match="nested too deeply"):
        read(tmp_path)
