"""Calls of a kernel's functions, written down and then made by compiled code: no Python runs
between them.

A thread that calls compiled code by itself hundreds of times a second waits for the interpreter's
lock as often, and with many threads longer than it computes.
"""

from __future__ import annotations

import numpy as np

from ravenjax.engines.cpu.target import Workspace

ARGUMENTS = {
    "shared_begin": ("ptr",) * 2,
    "shared_run": (*("ptr",) * 4, "i64", "i64", "ptr", "i32", "i64"),
    "lane_begin": ("ptr",) * 3,
    "lane_run": (*("ptr",) * 5, "i64", "i64", "ptr", "ptr", "i64", "i64", "i64"),
    "lane_finish": ("ptr",) * 4,
    "copy_bytes": ("ptr", "ptr", "i64"),
}
"""What can be called, and the types of the arguments; `copy_bytes` is to, from, count."""
NAME = "make_calls"
_NUMBERS = {name: number for number, name in enumerate(ARGUMENTS)}
_SIZE = 1 + max(map(len, ARGUMENTS.values()))  # numbers of a call: which, and its arguments
POINTERS = np.array(
    [
        [False, *(kind == "ptr" for kind in (*kinds, *("",) * (_SIZE - 1 - len(kinds))))]
        for kinds in ARGUMENTS.values()
    ]
)
"""Which numbers of a call are addresses, bool [functions, numbers]."""


def print_calls() -> str:
    """LLVM IR of the function that makes `%count` calls, to stand in the kernel's module."""
    cases = [f"    i64 {number}, label %{name}" for name, number in _NUMBERS.items()]
    lines = [
        "define void @copy_bytes(ptr noalias %to, ptr noalias %from, i64 %count) {",
        "  call void @llvm.memcpy.p0.p0.i64(ptr %to, ptr %from, i64 %count, i1 false)",
        "  ret void",
        "}",
        "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
        f"define void @{NAME}(ptr %calls, i64 %count) {{",
        "entry:",
        "  br label %again",
        "again:",
        "  %k = phi i64 [ 0, %entry ], [ %next, %made ]",
        "  %more = icmp ult i64 %k, %count",
        "  br i1 %more, label %choose, label %end",
        "choose:",
        f"  %offset = mul i64 %k, {8 * _SIZE}",
        "  %call = getelementptr i8, ptr %calls, i64 %offset",
        "  %which = load i64, ptr %call, align 8",
        "  switch i64 %which, label %made [",
        *cases,
        "  ]",
    ]
    for name, types in ARGUMENTS.items():
        lines.append(f"{name}:")
        values = []
        for k, kind in enumerate(types):
            value = f"%{name}{k}"
            lines.append(f"  {value}p = getelementptr i8, ptr %call, i64 {8 * (k + 1)}")
            lines.append(f"  {value} = load {kind}, ptr {value}p, align 8")
            values.append(f"{kind} {value}")
        lines += [f"  call void @{name}({', '.join(values)})", "  br label %made"]
    return "\n".join(
        [
            *lines,
            "made:",
            "  %next = add i64 %k, 1",
            "  br label %again",
            "end:",
            "  ret void",
            "}",
            "",
        ]
    )


class CallList:
    """Calls to be made of the functions of a module; what their addresses point to must live
    until they are made.
    """

    def __init__(self, space: Workspace) -> None:
        """space: of a module with `NAME`; its own buffers are what addresses may point to."""
        self._space = space
        self._calls: list[tuple[int, ...]] = []

    def add(self, name: str, *arguments: int) -> None:
        """Write down a call: addresses and whole numbers, as in `ARGUMENTS`."""
        self._calls.append((_NUMBERS[name], *arguments, *(0,) * (_SIZE - 1 - len(arguments))))

    def make(self) -> None:
        """Make the calls in their order, and forget them."""
        calls = np.array(self._calls, np.int64).reshape(-1, _SIZE)
        self._calls.clear()
        self._space.make(calls)
