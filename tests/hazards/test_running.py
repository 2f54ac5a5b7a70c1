"""One run of each case of each runnable hazard: it executes, and it changes at least one bit of
a signal.
"""

from typing import Any

import pytest

import ravenjax as rj
from ravenjax.hazards import expansion


def single(group: dict[str, Any]) -> dict[str, Any]:
    """The group cut to one run: the last of each list, one draw of each distribution."""

    def one(value: Any) -> Any:
        return value[-1] if isinstance(value, list) else value

    faults = [{key: one(value) for key, value in fault.items()} for fault in group["fault"]]
    return {**group, "fault": faults, **({"runs": 1} if "runs" in group else {"design": "grid"})}


@pytest.mark.slow
def test_one_run_of_each_case_executes_and_is_activated() -> None:
    groups = [
        single(group) for group in expansion.expand_group({"name": "library", "hazards": "all"})
    ]
    for group in groups:
        for fault in group["fault"]:  # "*" would be a run a channel
            if fault.get("channel") == "*":
                fault["channel"] = "shoulder"
    table = rj.run({"campaign": {"name": "library", "duration_s": 2.5}, "group": groups})
    assert len(table) == len(groups)
    assert (table["failed"] == "").all()
    assert list(table.loc[~table["activated"], "group"]) == []
