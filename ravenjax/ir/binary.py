"""A program as bytes and back: a line of JSON, then one array a property of the operations."""

from __future__ import annotations

import json

import numpy as np

from ravenjax.ir.program import Operation, Program


def to_bytes(program: Program) -> bytes:
    """The program, all but the origins of its operations."""
    operations = program.operations
    names = sorted({operation.name for operation in operations})
    dtypes = sorted({operation.dtype for operation in operations})
    header = {
        "names": names,
        "dtypes": dtypes,
        "operations": len(operations),
        "operands": sum(len(operation.operands) for operation in operations),
        "inputs": program.inputs,
        "outputs": program.outputs,
        "tables": program.tables,
    }
    name_of, dtype_of = ({text: k for k, text in enumerate(texts)} for texts in (names, dtypes))
    columns = (
        np.array([name_of[operation.name] for operation in operations], "<u1"),
        np.array([dtype_of[operation.dtype] for operation in operations], "<u1"),
        np.array([len(operation.operands) for operation in operations], "<u1"),
        np.array([operation.detail is not None for operation in operations], "<u1"),
        np.array([operand for operation in operations for operand in operation.operands], "<i4"),
        np.array([operation.detail or 0 for operation in operations], "<u8"),
    )
    return json.dumps(header).encode() + b"\n" + b"".join(column.tobytes() for column in columns)


def from_bytes(content: bytes) -> Program:
    """The program of `to_bytes`. Raises ValueError for anything else."""
    line, _, rest = content.partition(b"\n")
    header = json.loads(line)
    names, dtypes, count = header["names"], header["dtypes"], header["operations"]
    offset = 0

    def column(dtype: str, length: int) -> list[int]:
        nonlocal offset
        values = np.frombuffer(rest, dtype, length, offset)
        offset += values.nbytes
        return values.tolist()

    name_of, dtype_of, lengths, flags = (column("<u1", count) for _ in range(4))
    operands, details = column("<i4", header["operands"]), column("<u8", count)
    operations, at = [], 0
    for name, dtype, length, has_detail, detail in zip(
        name_of, dtype_of, lengths, flags, details, strict=True
    ):
        operations.append(
            Operation(
                names[name],
                dtypes[dtype],
                tuple(operands[at : at + length]),
                detail if has_detail else None,
            )
        )
        at += length
    return Program(
        tuple(operations),
        tuple(header["inputs"]),
        tuple(header["outputs"]),
        tuple((dtype, length) for dtype, length in header["tables"]),
        ("",) * count,
    )
