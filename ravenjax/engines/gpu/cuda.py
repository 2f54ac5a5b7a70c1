"""Prints a program without loops as CUDA C: one statement per operation, one robot per thread.

The code calls only the functions of prelude.cu.j2, and no mathematical library. `OPTIONS` forbid
the compiler to fuse operations or to flush denormal numbers: every operation rounds its result.
All devices therefore give the same bits, except for the payload of a NaN. Numbers have 32 bits.
"""

from collections.abc import Sequence

import numpy as np

from ravenjax import resources
from ravenjax.engines.printing import Printing
from ravenjax.ir.program import Program

OPTIONS = ("--fmad=false", "--ftz=false", "--prec-div=true", "--prec-sqrt=true")
"""Options of the compiler that keep each operation's rounding."""

_TEXTS = resources.read_tables(__file__, "cuda.toml")
_TYPES = _TEXTS["types"]


class CudaPrinter(Printing[str]):
    """Prints the body of one function. A place is the C text of a 32-bit word in memory."""

    def __init__(self, indent: str = "  "):
        super().__init__()
        self._indent = indent

    def line(self, text: str) -> None:
        """Add a statement."""
        self.lines.append(self._indent + text)

    def text(self) -> str:
        """Return all statements, each with its line end."""
        return "".join(f"{line}\n" for line in self.lines)

    def _constant(self, dtype: str, value) -> str:
        # Returns a constant as C text, exact to the bit.
        if dtype == "bool":
            return "true" if value else "false"
        if dtype == "int32":
            return f"(int)0x{int(value) & 0xFFFFFFFF:x}u" if value < 0 else str(int(value))
        if dtype == "uint32":
            return f"{int(value)}u"
        if np.isfinite(value):
            # Nine digits distinguish all float32 numbers.
            text = f"{float(value):.9g}"
            # C takes 1f for an error, so a number without point or exponent gets a point.
            return f"({text}{'' if set(text) & set('.e') else '.'}f)"
        return f"__uint_as_float(0x{int(np.asarray(value).view(np.uint32)):x}u)"

    def _load(self, dtype: str, place: str) -> str:
        return self._new(dtype, _TEXTS["words"][dtype][0].format(place))

    def _store(self, dtype: str, value: str, place: str):
        self.line(f"{place} = {_TEXTS['words'][dtype][1].format(value)};")

    def _operation(self, program: Program, i: int, inputs: list[str]) -> str:
        # Prints one operation. Returns the name of its result.
        name, dtype, operands, detail = program.operations[i]
        first = program.operations[operands[0]]
        # `detail` is the number of the table; tables are consecutive in memory.
        if name == "lookup":
            start = sum(length for _, length in program.tables[:detail])
            return self._load(dtype, f"__ldg(tables + {start} + {inputs[0]})")
        types = [program.operations[o].dtype for o in operands]
        return self._new(dtype, _operation_text(name, dtype, types, inputs, first.value))

    def _begin_region(self, condition: str, types: list[str]) -> list[str]:
        # Prints the beginning of an `if`, with variables for the results of its block.
        names = [self._name() for _ in types]
        for dtype, name in zip(types, names, strict=True):
            self.line(f"{_TYPES[dtype]} {name} = 0;")
        self.line(f"if ({condition}) {{")
        return names

    def _end_region(self, begun: list[str], results: list[str]) -> list[str]:
        for name, result in zip(begun, results, strict=True):
            self.line(f"{name} = {result};")
        self.line("}")
        return begun

    def _name(self) -> str:
        self._count += 1
        return f"v{self._count}"

    def _new(self, dtype: str, text: str) -> str:
        # Declares a variable with this value, and returns its name.
        name = self._name()
        self.line(f"const {_TYPES[dtype]} {name} = {text};")
        return name


def _operation_text(name: str, dtype: str, sources: Sequence[str], x: Sequence[str], known) -> str:
    """Return the C text of an operation. x: texts of the operands. sources: their types. known:
    value of the first operand if it is a constant, else None.
    """
    real, source = dtype == "float32", sources[0]
    if "float64" in (dtype, *sources):
        raise NotImplementedError(f"operation {name!r} of float64 has no CUDA form")
    if not real and (form := _TEXTS["unsigned"].get(name)):
        text = form.format(*x)
        return f"(int)({text})" if dtype == "int32" else text
    if form := (_TEXTS["any"] | _TEXTS["real" if real else "whole"]).get(name):
        return form.format(*x)
    match name:
        case "not":
            return f"{'!' if dtype == 'bool' else '~'}{x[0]}"
        case "max" | "min":
            function = "larger" if name == "max" else "smaller"
            # One instruction, `larger_than`, equals `larger` if the first operand is not 0 or NaN.
            is_plain = real and known is not None and known != 0 and not np.isnan(known)
            return f"{function}{'_than' if is_plain else ''}({x[0]}, {x[1]})"
        case "bitcast" | "convert":
            cast = _TEXTS[name].get(f"{source}-{dtype}", f"({_TYPES[dtype]})")
            return f"{cast}({x[0]})"
    raise NotImplementedError(f"operation {name!r} of {dtype} has no CUDA form")
