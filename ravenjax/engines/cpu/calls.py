"""The compiled function that makes a list of calls of a kernel's functions."""

from __future__ import annotations

ARGUMENTS = {
    "shared_begin": ("ptr",) * 2,
    "shared_run": (*("ptr",) * 4, "i64", "i64", "ptr", "i32", "i64"),
    "lane_begin": ("ptr",) * 3,
    "lane_run": (*("ptr",) * 5, "i64", "i64", "ptr", "ptr", "i64", "i64", "i64"),
    "lane_finish": ("ptr",) * 4,
    "copy_bytes": ("ptr", "ptr", "i64"),
}
"""What can be called, and the types of the arguments; `copy_bytes` is to, from, count."""
MAKE_CALLS = "make_calls"
CALL_WORDS = 1 + max(map(len, ARGUMENTS.values()))
"""64-bit words of a call: which function, and its arguments."""


def print_calls() -> str:
    """LLVM IR of the function that makes `%count` calls, to stand in the kernel's module."""
    cases = [f"    i64 {number}, label %{name}" for number, name in enumerate(ARGUMENTS)]
    lines = [
        "define void @copy_bytes(ptr noalias %to, ptr noalias %from, i64 %count) {",
        "  call void @llvm.memcpy.p0.p0.i64(ptr %to, ptr %from, i64 %count, i1 false)",
        "  ret void",
        "}",
        "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)",
        f"define void @{MAKE_CALLS}(ptr %calls, i64 %count) {{",
        "entry:",
        "  br label %again",
        "again:",
        "  %k = phi i64 [ 0, %entry ], [ %next, %made ]",
        "  %more = icmp ult i64 %k, %count",
        "  br i1 %more, label %choose, label %end",
        "choose:",
        f"  %offset = mul i64 %k, {8 * CALL_WORDS}",
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
