"""Printed CUDA C compiled as C++, one thread after the other: what can be checked of it without
a GPU.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ravenjax.engines.gpu import code as cuda_code
from ravenjax.engines.gpu import device as cuda_device
from ravenjax.errors import UserError

SHIM = """\
#include <cmath>
#include <cstddef>
#include <cstring>
#define __device__
#define __global__
#define __forceinline__ inline
#define __launch_bounds__(...)
#define __shared__
#define __align__(bytes)
#define __restrict__
struct uint4 { unsigned x, y, z, w; };
static struct { unsigned x; } threadIdx, blockIdx, blockDim;
unsigned block_room[1 << 20];
static void __syncthreads() {}
template <class T> static T __ldg(const T* place) { return *place; }
static unsigned __float_as_uint(float x) { unsigned y; std::memcpy(&y, &x, 4); return y; }
static int __float_as_int(float x) { return (int)__float_as_uint(x); }
static float __uint_as_float(unsigned x) { float y; std::memcpy(&y, &x, 4); return y; }
static float __int_as_float(int x) { return __uint_as_float((unsigned)x); }
static float __int2float_rn(int x) { return (float)x; }
static float __uint2float_rn(unsigned x) { return (float)x; }
static int __float2int_rz(float x) {
  return x != x ? 0 : x >= 2147483648.0f ? 2147483647 : x <= -2147483648.0f ? (int)0x80000000u : (int)x;
}
static unsigned __float2uint_rz(float x) {
  return !(x > 0.0f) ? 0u : x >= 4294967296.0f ? 0xffffffffu : (unsigned)x;
}
static void place(unsigned block, unsigned thread, unsigned threads) {
  blockIdx.x = block; threadIdx.x = thread; blockDim.x = threads;
}
extern "C" void set_place(unsigned block, unsigned thread, unsigned threads) { place(block, thread, threads); }
"""  # noqa: E501


class Library:
    """Compiled text; its kernels are called like those of a device."""

    def __init__(self, text: str, folder: Path) -> None:
        compiler = shutil.which("g++") or shutil.which("c++") or shutil.which("clang++")
        if compiler is None:
            pytest.skip("no C++ compiler is here (g++, c++ or clang++)")
        (folder / "kernel.cpp").write_text(SHIM + text)
        options = ["-std=c++17", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-w"]
        subprocess.run(
            [compiler, *options, "-o", folder / "kernel.so", folder / "kernel.cpp"],
            check=True,
            capture_output=True,
        )
        self._library = ctypes.CDLL(str(folder / "kernel.so"))

    def launch(
        self, name: str, blocks: int, threads: int, *arguments: np.ndarray | int | None
    ) -> None:
        """Run every thread of a kernel; arrays go by address."""
        given = [
            (
                ctypes.c_int(a)
                if isinstance(a, int)
                else ctypes.c_void_p(None if a is None else a.ctypes.data)
            )
            for a in arguments
        ]
        function = getattr(self._library, name)
        for block in range(blocks):
            for thread in range(threads):
                self._library.set_place(block, thread, threads)
                function(*given)


# --- a device made of that ---


class Device:
    """One like the smallest GPU."""

    number, name, architecture, multiprocessors, shared_bytes = 0, "C++", "sm_75", 1, 65536


class _Function:
    def __init__(self, library: Library, name: str) -> None:
        self.library, self.name = library, name


class _Module:
    def __init__(self, device: Device, cubin: Library) -> None:
        self.library = cubin

    def function(self, name: str, shared_bytes: int = 0) -> _Function:
        return _Function(self.library, name)


class _Session:
    main = urgent = None

    def __init__(self, device: Device) -> None: ...

    def __enter__(self) -> _Session:
        return self

    def __exit__(self, *error: object) -> None: ...

    def allocate(self, words: int) -> np.ndarray:
        return np.zeros(max(words, 1), np.uint32)

    def upload(self, words: np.ndarray) -> np.ndarray:
        return words.copy()

    def write(self, place: np.ndarray, words: np.ndarray, stream: None) -> None:
        place[: words.size] = words.reshape(-1)

    def read(self, words: np.ndarray, place: np.ndarray, stream: None) -> None:
        words.reshape(-1)[:] = place[: words.size]

    def launch(
        self, function: _Function, blocks: int, threads: int, stream: None, *arguments: Any
    ) -> None:
        function.library.launch(function.name, blocks, threads, *arguments)

    def mark(self, stream: None) -> None: ...

    def wait(self, stream: None, mark: None) -> None: ...

    def finish(self, mark: None) -> None: ...


def pretend(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Let engine cuda find one device that is this."""
    count = iter(range(1000))

    def compile(text: str, *_: object) -> Library:
        here = folder / str(next(count))
        here.mkdir()
        return Library(text, here)

    monkeypatch.setattr(cuda_device, "compile_cubin", compile)
    monkeypatch.setattr(cuda_device, "DeviceModule", _Module)
    monkeypatch.setattr(cuda_device, "visible_gpus", lambda: (Device(),))
    monkeypatch.setattr(cuda_code, "DeviceSession", _Session)


def real_or_pretended(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Let engine cuda find the GPU that is here, and where there is none, this."""
    try:
        cuda_device.visible_gpus()
    except UserError:
        pretend(monkeypatch, folder)
