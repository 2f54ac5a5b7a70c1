"""Campaign, search and scenario files with anything wrong anywhere: each is read, or refused by
one clear error.
"""

import pytest
from mutations import mutant

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


@pytest.mark.slow
@pytest.mark.parametrize("block", range(5))
def test_five_thousand_mutants_end_in_no_traceback(tmp_path, block):
    assert any(refused(number, tmp_path) for number in range(1000 * block, 1000 * (block + 1)))


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
