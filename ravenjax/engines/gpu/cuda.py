"""Prints straight-line programs as CUDA C: one statement per operation, one robot per thread.

The text calls no mathematical library. Every float operation is rounded separately, provided that
the compiler neither fuses nor flushes (`OPTIONS`). Therefore all devices give the same bits, except
for the payload of a NaN. Numbers have 32 bits; there is no float64.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.engines.printing import Printing
from ravenjax.ir.program import Program, from_bits

OPTIONS = ("--fmad=false", "--ftz=false", "--prec-div=true", "--prec-sqrt=true")
"""Options of the compiler that keep each operation's rounding."""

_TYPES = {"float32": "float", "int32": "int", "uint32": "unsigned", "bool": "bool"}
_WORDS = {
    "float32": ("__uint_as_float({})", "__float_as_uint({})"),
    "int32": ("(int)({})", "(unsigned)({})"),
    "uint32": ("{}", "{}"),
    "bool": ("({}) != 0u", "(unsigned)({})"),
}
"""How a number is read from a word, and how it is written to one."""
_SIGNS = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "and": "&", "or": "|", "xor": "^"}
_ANY = {
    **{name: f"{{0}} {sign} {{1}}" for name, sign in _SIGNS.items()},
    "select": "{0} ? {1} : {2}",
    "rarely": "{0} ? {1} : {2}",
    "truncate": "truncated({0})",
}
_REAL = _ANY | {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "fma": "fmaf({0}, {1}, {2})",
    "neg": "-{0}",
    "abs": "fabsf({0})",
    "sqrt": "sqrtf({0})",
    "floor": "floorf({0})",
    "ceil": "ceilf({0})",
    "round": "rintf({0})",
}
_WHOLE = _ANY | {
    "div": "quotient({0}, {1})",
    "rem": "rest({0}, {1})",
    "abs": "{0} < 0 ? (int)(0u - (unsigned){0}) : {0}",
}
_UNSIGNED = {
    "add": "(unsigned){0} + (unsigned){1}",
    "sub": "(unsigned){0} - (unsigned){1}",
    "mul": "(unsigned){0} * (unsigned){1}",
    "neg": "0u - (unsigned){0}",
    "shl": "left({0}, {1})",
    "shr": "right({0}, {1})",
    "sar": "signed_right({0}, {1})",
}
"""Operations on whole numbers with an unsigned result, because in C only unsigned numbers wrap."""
_BITCASTS = {
    ("float32", "int32"): "__float_as_int",
    ("float32", "uint32"): "__float_as_uint",
    ("int32", "float32"): "__int_as_float",
    ("uint32", "float32"): "__uint_as_float",
}
_CONVERTED = {
    ("float32", "int32"): "__float2int_rz",
    ("float32", "uint32"): "__float2uint_rz",
    ("int32", "float32"): "__int2float_rn",
    ("uint32", "float32"): "__uint2float_rn",
}

PRELUDE = """\
#define INLINE static __device__ __forceinline__
// Of two zeros of unlike sign the second; a NaN comes through.
template <class T> INLINE T larger(T a, T b) { return (a != a) | (a > b) ? a : b; }
template <class T> INLINE T smaller(T a, T b) { return (a != a) | (a < b) ? a : b; }
// The same where the first is no NaN and no zero.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
INLINE float larger_than(float c, float x) { asm("max.NaN.f32 %0, %0, %1;" : "+f"(x) : "f"(c)); return x; }
INLINE float smaller_than(float c, float x) { asm("min.NaN.f32 %0, %0, %1;" : "+f"(x) : "f"(c)); return x; }
#else
INLINE float larger_than(float c, float x) { return c > x ? c : x; }
INLINE float smaller_than(float c, float x) { return c < x ? c : x; }
#endif
// C's (int)x on x86: -2147483648 for what does not fit.
INLINE int truncated(float x) { return x < 2147483648.0f ? __float2int_rz(x) : (int)0x80000000u; }
// By 0: all bits set; wraps.
INLINE int quotient(int a, int b) { return b == 0 ? -1 : b == -1 ? (int)(0u - (unsigned)a) : a / b; }
INLINE unsigned quotient(unsigned a, unsigned b) { return b == 0 ? ~0u : a / b; }
INLINE int rest(int a, int b) { return b == 0 ? a : b == -1 ? 0 : a % b; }
INLINE unsigned rest(unsigned a, unsigned b) { return b == 0 ? a : a % b; }
// Shifts by 32 and more shift everything out.
INLINE unsigned left(unsigned x, unsigned by) { return by < 32u ? x << by : 0u; }
INLINE unsigned right(unsigned x, unsigned by) { return by < 32u ? x >> by : 0u; }
INLINE int signed_right(int x, unsigned by) { return x >> (by < 31u ? by : 31u); }
"""  # noqa: E501
"""Functions that the statements call."""


class CudaPrinter(Printing[str]):
    """Prints the body of one function. A place is a 32-bit word, as text of an lvalue."""

    def __init__(self, indent: str = "  ") -> None:
        super().__init__()
        self._indent = indent

    def line(self, text: str) -> None:
        """Add a statement."""
        self.lines.append(self._indent + text)

    def text(self) -> str:
        """Return all statements, each with its line end."""
        return "".join(f"{line}\n" for line in self.lines)

    def _constant(self, dtype: str, value: Any) -> str:
        if dtype == "bool":
            return "true" if value else "false"
        if dtype == "int32":
            return f"(int)0x{int(value) & 0xFFFFFFFF:x}u" if value < 0 else str(int(value))
        if dtype == "uint32":
            return f"{int(value)}u"
        if np.isfinite(value):
            # Nine digits distinguish all float32 numbers.
            text = f"{float(value):.9g}"
            return f"({text}{'' if set(text) & set('.e') else '.'}f)"
        return f"__uint_as_float(0x{int(np.asarray(value).view(np.uint32)):x}u)"

    def _load(self, dtype: str, place: str) -> str:
        return self._new(dtype, _WORDS[dtype][0].format(place))

    def _store(self, dtype: str, value: str, place: str) -> None:
        self.line(f"{place} = {_WORDS[dtype][1].format(value)};")

    def _operation(self, program: Program, i: int, inputs: list[str], tables: str) -> str:
        name, dtype, operands, detail = program.operations[i]
        first = program.operations[operands[0]]
        if name == "lookup":
            start = sum(length for _, length in program.tables[:detail])
            return self._load(dtype, f"__ldg({tables} + {start} + {inputs[0]})")
        literal = from_bits(first.dtype, first.detail) if first.name == "constant" else None
        types = [program.operations[o].dtype for o in operands]
        return self._new(dtype, _operation_text(name, dtype, types, inputs, literal))

    def _begin_region(self, condition: str, types: list[str]) -> list[str]:
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
        name = self._name()
        self.line(f"const {_TYPES[dtype]} {name} = {text};")
        return name


def _operation_text(
    name: str, dtype: str, sources: Sequence[str], x: Sequence[str], known: Any
) -> str:
    """Return an operation on `x` of types `sources`. known: the first operand if a constant."""
    real, source = dtype == "float32", sources[0]
    if "float64" in (dtype, *sources):
        raise NotImplementedError(f"operation {name!r} of float64 has no CUDA form")
    if not real and name in _UNSIGNED:
        text = _UNSIGNED[name].format(*x)
        return f"(int)({text})" if dtype == "int32" else text
    if form := (_REAL if real else _WHOLE).get(name):
        return form.format(*x)
    match name:
        case "not":
            return f"{'!' if dtype == 'bool' else '~'}{x[0]}"
        case "max" | "min":
            function = "larger" if name == "max" else "smaller"
            plain = real and known is not None and known != 0 and not np.isnan(known)
            return f"{function}{'_than' if plain else ''}({x[0]}, {x[1]})"
        case "bitcast" | "convert":
            casts = _BITCASTS if name == "bitcast" else _CONVERTED
            return f"{casts.get((source, dtype), f'({_TYPES[dtype]})')}({x[0]})"
    raise NotImplementedError(f"operation {name!r} of {dtype} has no CUDA form")
