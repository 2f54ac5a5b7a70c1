"""Lists NVIDIA GPUs, compiles code, manages memory and launches kernels, by NVIDIA's bindings.

The bindings are optional packages that are imported at first use. The return code of every call is
checked. An error that a user can correct becomes a UserError of one line.
"""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np

from ravenjax.engines.trace_key import Objects, hash_values, load_or_make
from ravenjax.errors import UserError

INSTALL = "pip install 'ravenjax[cuda]'"


def _bindings() -> tuple[Any, Any]:
    # Returns the modules of the driver and of the compiler. Raises UserError without them.
    try:
        from cuda.bindings import driver, nvrtc  # type: ignore[import-not-found]
    except ImportError as error:
        raise UserError(
            f"engine 'cuda' needs the package cuda-bindings ({error}): {INSTALL}"
        ) from None
    return driver, nvrtc


def _call(name: str, *arguments) -> Any:
    """Return the result of a driver function. Raises RuntimeError with the driver's message."""
    driver, _ = _bindings()
    code, *results = getattr(driver, name)(*arguments)
    if int(code) != 0:
        _, text = driver.cuGetErrorString(code)
        raise RuntimeError(f"{name}: {text.decode() if text else code}")
    return results[0] if len(results) == 1 else tuple(results)


@cache
def visible_gpus() -> tuple[Device, ...]:
    """Return every GPU that this process may use. Raises UserError if none can be used."""
    _bindings()
    try:
        _call("cuInit", 0)
        gpus = tuple(Device(k) for k in range(_call("cuDeviceGetCount")))
    # The bindings raise exceptions of their own classes if the driver is absent.
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(
            f"engine 'cuda' finds no NVIDIA driver ({reason}). Engine 'simd' needs no GPU"
        ) from None
    if not gpus:
        raise UserError("engine 'cuda' finds no NVIDIA GPU. Use engine 'simd', which needs no GPU")
    return gpus


@dataclasses.dataclass(frozen=True)
class Device:
    """One GPU, identified by its number among the visible GPUs."""

    number: int

    def _attribute(self, name: str) -> int:
        driver, _ = _bindings()
        attribute = getattr(driver.CUdevice_attribute, f"CU_DEVICE_ATTRIBUTE_{name}")
        return int(_call("cuDeviceGetAttribute", attribute, self._handle))

    @cached_property
    def _handle(self) -> Any:
        return _call("cuDeviceGet", self.number)

    @cached_property
    def context(self) -> Any:
        """The device's primary context, which other libraries use as well."""
        return _call("cuDevicePrimaryCtxRetain", self._handle)

    @cached_property
    def name(self) -> str:
        """Name of the device, as given by its maker."""
        return _call("cuDeviceGetName", 256, self._handle).split(b"\0")[0].decode()

    @cached_property
    def architecture(self) -> str:
        """Architecture in NVRTC's format, such as "sm_90"."""
        major, minor = (self._attribute(f"COMPUTE_CAPABILITY_{x}") for x in ("MAJOR", "MINOR"))
        return f"sm_{major}{minor}"

    @cached_property
    def multiprocessors(self) -> int:
        """Number of multiprocessors."""
        return self._attribute("MULTIPROCESSOR_COUNT")

    @cached_property
    def shared_bytes(self) -> int:
        """Largest shared memory of one block, bytes."""
        return self._attribute("MAX_SHARED_MEMORY_PER_BLOCK_OPTIN")


def require_gpu() -> None:
    """Raise UserError unless there is a GPU and code can be compiled for all GPUs."""
    for device in visible_gpus():
        _compiler_for(device.architecture)


def compile_cubin(
    text: str, architecture: str, options: Sequence[str], objects: Objects | None = None
) -> bytes:
    """Compile a module's text, or load it from `objects`. Raises UserError and RuntimeError."""
    nvrtc, version = _compiler_for(architecture)
    flags = [f"--gpu-architecture={architecture}", "--std=c++17", "--disable-warnings", *options]
    key = hash_values(version, flags, text)
    return load_or_make(objects, key, lambda: _compiled(nvrtc, text, flags))


def _compiler_for(architecture: str) -> tuple[Any, tuple[int, int]]:
    """Return module `nvrtc` and its version. Raises UserError if it lacks the architecture."""
    _, nvrtc = _bindings()
    try:
        _, major, minor = nvrtc.nvrtcVersion()
        architectures = nvrtc.nvrtcGetSupportedArchs()[1]
    # The bindings raise exceptions of their own classes if the library is absent.
    except Exception as error:
        raise UserError(
            f"engine 'cuda' finds no NVRTC ({str(error).splitlines()[0]}): {INSTALL}"
        ) from None
    if int(architecture[3:]) not in architectures:
        raise UserError(
            f"engine 'cuda' cannot compile for {architecture}: NVRTC {major}.{minor} supports"
            f" sm_{min(architectures)} to sm_{max(architectures)}. Use engine 'simd', which needs"
            " no GPU"
        )
    return nvrtc, (major, minor)


def _compiled(nvrtc, text: str, flags: list[str]) -> bytes:
    # Compiles CUDA C, without headers, to machine code of one GPU architecture (in `flags`).
    _, program = nvrtc.nvrtcCreateProgram(text.encode(), b"tick.cu", 0, [], [])
    try:
        (code,) = nvrtc.nvrtcCompileProgram(program, len(flags), [flag.encode() for flag in flags])
        if int(code) != 0:
            log = bytearray(nvrtc.nvrtcGetProgramLogSize(program)[1])
            nvrtc.nvrtcGetProgramLog(program, log)
            raise RuntimeError(f"NVRTC refuses the printed kernel: {log.decode()[:2000]}")
        cubin = bytearray(nvrtc.nvrtcGetCUBINSize(program)[1])
        nvrtc.nvrtcGetCUBIN(program, cubin)
    finally:
        nvrtc.nvrtcDestroyProgram(program)
    return bytes(cubin)


class DeviceModule:
    """Machine code loaded on a device."""

    def __init__(self, device: Device, cubin: bytes):
        _call("cuCtxSetCurrent", device.context)
        self._module = _call("cuModuleLoadData", cubin)

    def function(self, name: str, shared_bytes: int = 0) -> Function:
        """Return a kernel whose blocks have `shared_bytes` of dynamic shared memory."""
        driver, _ = _bindings()
        handle = _call("cuModuleGetFunction", self._module, name.encode())
        if shared_bytes:
            attribute = driver.CUfunction_attribute.CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES
            _call("cuFuncSetAttribute", handle, attribute, shared_bytes)
        return Function(handle, shared_bytes)


@dataclasses.dataclass(frozen=True)
class Function:
    """A kernel."""

    handle: Any
    shared_bytes: int


class DeviceSession:
    """The streams and the memory of one thread on one device, which are freed at the end."""

    def __init__(self, device: Device):
        self.device = device
        self._allocated: list[Any] = []
        self._events: list[Any] = []

    def __enter__(self) -> DeviceSession:
        # Creates two streams: `urgent` computes rows and copies, `main` runs lanes.
        driver, _ = _bindings()
        _call("cuCtxSetCurrent", self.device.context)
        lowest, highest = _call("cuCtxGetStreamPriorityRange")
        flag = driver.CUstream_flags.CU_STREAM_NON_BLOCKING
        self.main = _call("cuStreamCreateWithPriority", flag, lowest)
        self.urgent = _call("cuStreamCreateWithPriority", flag, highest)
        return self

    def __exit__(self, *_: object) -> None:
        # Waits for all work, and frees memory, events and streams.
        for stream in (self.main, self.urgent):
            _call("cuStreamSynchronize", stream)
        for room in self._allocated:
            _call("cuMemFreeAsync", room, self.main)
        for event in self._events:
            _call("cuEventDestroy", event)
        for stream in (self.main, self.urgent):
            _call("cuStreamSynchronize", stream)
            _call("cuStreamDestroy", stream)

    def allocate(self, words: int) -> Any:
        """Allocate zeroed memory for `words` 32-bit words, usable from both streams."""
        # The driver may refuse a size of 0.
        size = max(words, 4)
        address = _call("cuMemAllocAsync", 4 * size, self.main)
        self._allocated.append(address)
        _call("cuMemsetD32Async", address, 0, size, self.main)
        self.wait(self.urgent, self.mark(self.main))
        return address

    def upload(self, words: np.ndarray) -> Any:
        """Return new device memory with a copy of an array."""
        address = self.allocate(words.nbytes // 4)
        self.write(address, words, self.urgent)
        self.wait(self.main, self.mark(self.urgent))
        return address

    def write(self, place: Any, words: np.ndarray, stream: Any) -> None:
        """Copy a contiguous array to the device."""
        if words.nbytes:
            _call("cuMemcpyHtoDAsync", place, words.ctypes.data, words.nbytes, stream)

    def read(self, words: np.ndarray, place: Any, stream: Any) -> None:
        """Copy from the device into a contiguous array, and wait for the copy."""
        if words.nbytes:
            _call("cuMemcpyDtoHAsync", words.ctypes.data, place, words.nbytes, stream)
        _call("cuStreamSynchronize", stream)

    def launch(
        self, function: Function, blocks: int, threads: int, stream: Any, *arguments: Any
    ) -> None:
        """Start a kernel. Integer arguments become C ints, others addresses, and None null."""
        # The grid has blocks x 1 x 1 blocks, and each block has threads x 1 x 1 threads.
        values = tuple(0 if a is None else int(a) for a in arguments)
        types = tuple(ctypes.c_int if isinstance(a, int) else ctypes.c_void_p for a in arguments)
        _call(
            "cuLaunchKernel",
            *(function.handle, blocks, 1, 1, threads, 1, 1, function.shared_bytes),
            *(stream, (values, types), 0),
        )

    def mark(self, stream: Any) -> Any:
        """Return a mark that is reached when the work queued in a stream so far is done."""
        driver, _ = _bindings()
        event = _call("cuEventCreate", driver.CUevent_flags.CU_EVENT_DISABLE_TIMING)
        self._events.append(event)
        _call("cuEventRecord", event, stream)
        return event

    def wait(self, stream: Any, mark: Any) -> None:
        """Let a stream wait until another one has reached a mark."""
        _call("cuStreamWaitEvent", stream, mark, 0)

    @staticmethod
    def finish(mark: Any) -> None:
        """Block until a mark is reached."""
        _call("cuEventSynchronize", mark)
