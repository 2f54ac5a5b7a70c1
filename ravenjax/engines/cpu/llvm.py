"""Prints a program without loops as LLVM IR, about one vector instruction per operation.

Each instruction computes `width` lanes. A `Place` gives the location of numbers in memory. LLVM may
neither fuse nor reassociate operations on floats, so all widths and CPUs give the same bits.
WebAssembly is the exception, because its `fma` rounds twice.

Sine and similar functions are polynomials, or functions of the C library. Functions of the C
library are called for one lane at a time. Python's `math` calls them too and gives the same bits.
"""

import struct
from collections.abc import Mapping

import numpy as np

from ravenjax import resources
from ravenjax.engines.cpu.jit import FUSED
from ravenjax.engines.cpu.memory import Place, stored_size
from ravenjax.engines.printing import Printing
from ravenjax.ir.program import Program
from ravenjax.ir.semantics import LIBRARY

TEXTS = resources.read_tables(__file__, "llvm.toml")
_STORED, _KINDS = TEXTS["stored"], TEXTS["kinds"]
_TYPES: dict[str, str] = {**_STORED, "bool": "i1"}


class LlvmPrinter(Printing[Place]):
    """Prints the body of one function for `width` lanes on a CPU with these features."""

    def __init__(self, width: int, features: frozenset[str], in_loop: bool = False):
        """in_loop: whether the lines become the body of a loop, by `repeat_lines`."""
        super().__init__()
        self.width, self.features, self.block = width, features, "again" if in_loop else "entry"
        self.declared: set[str] = set()

    def _operation(self, program: Program, i: int, inputs: list[str]) -> str:
        # Prints operation `i` on the values `inputs`. Returns the name of its result.
        name, dtype, operands, detail = program.operations[i]
        if name == "lookup":
            return self._lookup(program, detail, inputs[0])
        # Operands: condition, number where it is true, number where it is false.
        if name in ("select", "rarely"):
            # Avoids a mistake of LLVM, which `_select_as_floats` describes.
            is_logic = any(program.operations[o].name in ("and", "or", "xor") for o in operands[1:])
            if is_logic and dtype in ("int32", "uint32") and self.width > 1:
                return self._select_as_floats(dtype, inputs)
            return self.select(dtype, *inputs)
        sources = [program.operations[o] for o in operands]
        # A constant NaN does not count as known, because `max` and `min` must return it.
        known = [o.name == "constant" and not np.isnan(o.value) for o in sources]
        return self._compute(name, dtype, sources[0].dtype, inputs, known)

    def _begin_region(self, condition: str, types: list[str]):
        # Prints a branch around operations that no lane of the vector needs. Returns the labels of
        # the blocks before and after the branch, and the types of the region's results.
        if self.width > 1:
            name = f"llvm.vector.reduce.or.v{self.width}i1"
            condition = self.call("i1", name, (self.type("bool"), condition))
        self._count += 1
        outer, self.block = self.block, f"rare{self._count}"
        after = f"after{self._count}"
        self.lines.append(f"br i1 {condition}, label %{self.block}, label %{after}, !prof !0")
        self.lines.append(f"{self.block}:")
        return outer, after, types

    def _end_region(self, begun: tuple[str, str, list[str]], results: list[str]) -> list[str]:
        # Closes the branch. A `phi` is the result, or 0 if the branch was skipped, which the lanes'
        # `select` ignores.
        outer, after, types = begun
        self.lines += [f"br label %{after}", f"{after}:"]
        values = []
        for dtype, x in zip(types, results, strict=True):
            sources = f"[ {x}, %{self.block} ], [ {self._constant(dtype, 0)}, %{outer} ]"
            values.append(self.op(f"phi {self.type(dtype)} {sources}"))
        self.block = after
        return values

    def type(self, dtype: str) -> str:
        """Return the LLVM type of a number in registers."""
        return self._vector_of(_TYPES[dtype])

    def _vector_of(self, scalar: str) -> str:
        # Returns the LLVM type of a vector of all lanes, or of the number itself for one lane.
        return scalar if self.width == 1 else f"<{self.width} x {scalar}>"

    def op(self, text: str) -> str:
        """Add an instruction, and return its new value."""
        self._count += 1
        self.lines.append(f"%v{self._count} = {text}")
        return f"%v{self._count}"

    def call(self, result: str, name: str, *arguments: tuple[str, str]) -> str:
        """Call a function or intrinsic, given type and text of each argument; return the value."""
        self.declared.add(f"declare {result} @{name}({', '.join(kind for kind, _ in arguments)})")
        return self.op(f"call {result} @{name}({', '.join(map(' '.join, arguments))})")

    def select(self, dtype: str, condition: str, yes: str, no: str) -> str:
        """Return a value that is `yes` or `no` in each lane."""
        wide = self.type(dtype)
        return self.op(f"select {self.type('bool')} {condition}, {wide} {yes}, {wide} {no}")

    def intrinsic(self, name: str, dtype: str, *inputs: str) -> str:
        """Call an intrinsic function whose operands and result have one type."""
        wide, suffix = self.type(dtype), self._type_suffix(dtype)
        return self.call(wide, f"llvm.{name}.{suffix}", *((wide, x) for x in inputs))

    def _constant(self, dtype: str, value) -> str:
        # Returns a constant as text, with the same value in each lane.
        if dtype == "bool":
            text = "true" if value else "false"
        # LLVM writes floats of both sizes as the 64 bits of a float64.
        elif dtype.startswith("float"):
            text = f"0x{struct.unpack('>Q', struct.pack('>d', float(value)))[0]:016X}"
        else:
            text = str(int(value))
        return text if self.width == 1 else f"splat ({_TYPES[dtype]} {text})"

    def address(self, place: Place) -> str:
        """Return a pointer to a place."""
        if not place.offset:
            return place.pointer
        return self.op(f"getelementptr i8, ptr {place.pointer}, i64 {place.offset}")

    def _load(self, dtype: str, place: Place) -> str:
        # Loads one number per lane; one that all lanes share (splat) is loaded once and copied.
        scalar, wide, address = _STORED[dtype], self._vector_of(_STORED[dtype]), self.address(place)
        if place.splat and self.width > 1:
            number = self.op(f"load {scalar}, ptr {address}, align {stored_size(dtype)}")
            start = self.op(f"insertelement {wide} poison, {scalar} {number}, i64 0")
            zeros = f"<{self.width} x i32> zeroinitializer"
            value = self.op(f"shufflevector {wide} {start}, {wide} poison, {zeros}")
        else:
            value = self.op(f"load {wide}, ptr {address}, align {stored_size(dtype)}")
        if dtype != "bool":
            return value
        return self.op(f"icmp ne {self._vector_of('i32')} {value}, {self._constant('int32', 0)}")

    def _store(self, dtype: str, value: str, place: Place):
        # Stores one number per lane. In memory, a truth value is an int32, all bits set or none.
        if dtype == "bool":
            value = self.op(f"sext {self.type('bool')} {value} to {self._vector_of('i32')}")
        target = f"{self._vector_of(_STORED[dtype])} {value}, ptr {self.address(place)}"
        self.lines.append(f"store {target}, align {stored_size(dtype)}")

    def _select_as_floats(self, dtype: str, inputs: list[str]) -> str:
        """Select one of two integers as if they were floats. inputs: condition, then both integers.
        With AVX-512, LLVM 22.1 combines a logic operation on a constant and a following select into
        one instruction (a masked vpternlog), which may give the wrong bits.
        """
        wide, real = self.type(dtype), self.type("float32")
        sides = [self.op(f"bitcast {wide} {x} to {real}") for x in inputs[1:]]
        return self.op(f"bitcast {real} {self.select('float32', inputs[0], *sides)} to {wide}")

    def _compute(self, name: str, dtype: str, source: str, x: list[str], known: list[bool]) -> str:
        # Prints an operation on the operands `x` of type `source`: one instruction, an intrinsic
        # function, or a sequence of llvm.toml. Returns the result, of type `dtype`. known: whether
        # an operand is a constant other than NaN.
        real, kind, wide = dtype.startswith("float"), _KINDS[source], self.type(dtype)
        if instruction := TEXTS["instructions"][kind].get(name):
            return self.op(f"{instruction} {self.type(source)} {', '.join(x)}")
        if function := TEXTS["intrinsics"][kind].get(name):
            return self.intrinsic(function, dtype, *x)
        if name == "bitcast":
            if not real and not source.startswith("float"):
                return x[0]
            return self.op(f"bitcast {self.type(source)} {x[0]} to {wide}")
        if name in LIBRARY and self.width == 1:
            return self._call_library(name, dtype, x)
        # The words that the sequences of llvm.toml contain in braces.
        bits = stored_size(dtype) * 8
        constants = {"zero": 0, "one": 1, "ones": -1, "bits": bits, "last": bits - 1}
        words = {key: self._constant(dtype, value) for key, value in constants.items()}
        words |= {"type": wide, "truth": self.type("bool"), "sign": kind[0]}
        words |= {"double": self._vector_of("double"), "long": self._vector_of("i64")}
        words |= zip("xyz", x, strict=False)
        match name:
            case "shl" | "shr" | "sar":
                words["shift"] = TEXTS["shifts"][name]
                if name == "sar":
                    words["y"] = self.intrinsic("umin", dtype, x[1], words["last"])
                # A constant amount is less than the width; the builder removes other shifts.
                is_in_range = name == "sar" or known[1]
                return self._print_sequence("plain_shift" if is_in_range else "shift", words)
            case "div" | "rem" if not real and bits == 32:
                self._print_sequence("quotient", words)
                return self._print_sequence(name, words)
            case "fma" if self.features & FUSED:
                return self.intrinsic("fma", dtype, *x)
            # WebAssembly has no fused multiply-add.
            case "not" | "neg" | "fma":
                return self._print_sequence(name, words)
            case "abs":
                function = f"llvm.abs.{self._type_suffix(dtype)}"
                return self.call(wide, function, (wide, x[0]), ("i1", "false"))
            case "max" | "min":
                result = self._print_sequence(name, words)
                # "nan" also returns the first operand where it is NaN.
                return result if known[0] else self._print_sequence("nan", words)
            case "convert":
                return self._convert(dtype, source, x[0])
            case "truncate":
                return self._truncate(source, x[0])
        raise NotImplementedError(f"operation {name!r} of {dtype} has no LLVM form")

    def _type_suffix(self, dtype: str) -> str:
        # Returns the end of an intrinsic function's name, such as v8f32.
        scalar = {"float": "f32", "double": "f64"}.get(_TYPES[dtype], _TYPES[dtype])
        return scalar if self.width == 1 else f"v{self.width}{scalar}"

    def _print_sequence(self, name: str, words: dict[str, str]) -> str:
        """Print the instructions of llvm.toml under a name, and return the last value. words: texts
        of placeholders such as {x}. The result of a line `a = fadd {type} {x}, {y}` is added under
        the name a.
        """
        value = ""
        for line in TEXTS["sequences"][name].splitlines():
            target, instruction = line.split(" = ", 1)
            words[target] = value = self.op(instruction.format_map(words))
        return value

    def _convert(self, dtype: str, source: str, x: str) -> str:
        # Converts numbers. LLVM's own conversion is undefined for NaN and values out of range.
        # Names such as sitofp begin with the first letter of `_KINDS`, "signed" or "unsigned".
        wide, before = self.type(dtype), self.type(source)
        if dtype.startswith("float") and source.startswith("float"):
            return self.op(f"{'fpext' if dtype == 'float64' else 'fptrunc'} {before} {x} to {wide}")
        if dtype.startswith("float"):
            return self.op(f"{_KINDS[source][0]}itofp {before} {x} to {wide}")
        if not source.startswith("float"):
            return self._resize_integer(dtype, source, x)
        if dtype != "int32":
            suffix = f"{self._type_suffix(dtype)}.{self._type_suffix(source)}"
            return self.call(wide, f"llvm.fpto{_KINDS[dtype][0]}i.sat.{suffix}", (before, x))
        # `_truncate` gives -2^31 for NaN and for numbers out of range. This is wrong for numbers of
        # 2^31 and more (oge: greater or equal), and for NaN (uno: unequal to itself).
        result = self._truncate(source, x)
        is_too_large = f"oge {before} {x}, {self._constant(source, 2147483648.0)}"
        for condition, value in ((is_too_large, 2**31 - 1), (f"uno {before} {x}, {x}", 0)):
            is_special = self.op(f"fcmp {condition}")
            result = self.select(dtype, is_special, self._constant(dtype, value), result)
        return result

    def _resize_integer(self, dtype: str, source: str, x: str) -> str:
        # Converts an integer to another width: cuts high bits, or adds zeros or copies of the sign.
        size, before = stored_size(dtype), stored_size(source)
        if size == before:
            return x
        name = "trunc" if size < before else "sext" if _KINDS[source] == "signed" else "zext"
        return self.op(f"{name} {self.type(source)} {x} to {self.type(dtype)}")

    def _call_library(self, name: str, dtype: str, x: list[str]) -> str:
        """Call the C library's function of float64, and round the result to `dtype`."""
        if dtype == "float32":
            x = [self._convert("float64", dtype, operand) for operand in x]
        result = self.call("double", name, *(("double", operand) for operand in x))
        return self._convert(dtype, "float64", result) if dtype == "float32" else result

    def _truncate(self, source: str, x: str) -> str:
        """Convert floats to int32 as C's `(int)x` on x86: numbers that do not fit become -2^31."""
        wide, before = self.type("int32"), self.type(source)
        x86 = TEXTS["truncations"].get(str(self.width))
        if source == "float32" and x86 and x86["feature"] in self.features:
            # `more` are the arguments after the number.
            return self.call(wide, f"llvm.x86.{x86['function']}", (before, x), *x86["more"])
        suffix = f"{self._type_suffix('int32')}.{self._type_suffix(source)}"
        saturated = self.call(wide, f"llvm.fptosi.sat.{suffix}", (before, x))
        # Saturation is right for too small numbers. Too large numbers and NaN are not below 2^31.
        is_below = self.op(f"fcmp olt {before} {x}, {self._constant(source, 2147483648.0)}")
        return self.select("int32", is_below, saturated, self._constant("int32", -(2**31)))

    def _lookup(self, program: Program, table: int, index: str) -> str:
        """Return one number of a table for each lane. The tables are consecutive in memory."""
        dtype = program.tables[table][0]
        offset = sum(stored_size(kind) * length for kind, length in program.tables[:table])
        start, scalar = self.address(Place("%tables", offset)), _STORED[dtype]
        addresses = self.op(f"getelementptr {scalar}, ptr {start}, {self.type('int32')} {index}")
        if self.width == 1:
            return self.op(f"load {scalar}, ptr {addresses}, align {stored_size(dtype)}")
        value = self._constant(dtype, 0)
        # Lanes are loaded one by one, which is rare and works on every CPU.
        for lane in range(self.width):
            address = self.op(f"extractelement <{self.width} x ptr> {addresses}, i64 {lane}")
            loaded = self.op(f"load {scalar}, ptr {address}, align {stored_size(dtype)}")
            value = self.op(
                f"insertelement {self._vector_of(scalar)} {value}, {scalar} {loaded}, i64 {lane}"
            )
        return value


BRANCH_WEIGHTS = '!0 = !{!"branch_weights", i32 1, i32 2000}'
"""Metadata that marks a region as seldom entered. Every module with a region must contain it."""


def repeat_lines(
    name: str, parameters: str, printer: LlvmPrinter, steps: Mapping[str, str], attributes: str = ""
) -> str:
    """Return a function that repeats the lines of a printer %count times, with the counter %tick.
    The lines begin in block "again". steps: pointer -> number of bytes by which it advances per
    iteration, from the parameter with the same name and a 0 at the end.
    """
    last = printer.block
    lines = [
        f"%tick = phi i64 [ 0, %entry ], [ %next, %{last} ]",
        *(f"%{p} = phi ptr [ %{p}0, %entry ], [ %{p}1, %{last} ]" for p in steps),
        *printer.lines,
        *(f"%{p}1 = getelementptr i8, ptr %{p}, i64 {by}" for p, by in steps.items()),
        "%next = add i64 %tick, 1",
        "%more = icmp ult i64 %next, %count",
        "br i1 %more, label %again, label %end",
    ]
    body = "".join(f"  {line}\n" for line in lines)
    return (
        f"define void @{name}({parameters}){attributes} {{\nentry:\n  br label %again\n"
        f"again:\n{body}end:\n  ret void\n}}\n"
    )
