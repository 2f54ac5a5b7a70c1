"""Engine cuda on a real GPU; skipped, with one line, where there is none."""

import pytest
from cuda_cases import CASES, SOURCE, check, check_engines, cut

from ravenjax.engines.gpu import device as cuda_device
from ravenjax.engines.gpu.cuda import OPTIONS
from ravenjax.engines.gpu.device import DeviceSession
from ravenjax.errors import UserError


@pytest.fixture(scope="module")
def device():
    try:
        return cuda_device.visible_gpus()[0]
    except UserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def operations(device):
    return cuda_device.DeviceModule(
        device, cuda_device.compile_cubin(SOURCE, device.architecture, OPTIONS)
    )


@pytest.mark.parametrize("k", range(len(CASES)), ids=[name for name, _, _ in CASES])
def test_every_operation_gives_the_bits_that_it_means(device, operations, k):
    def launch(name, given, out, n):
        with DeviceSession(device) as session:
            there, room = session.upload(given), session.allocate(out.size)
            session.launch(operations.function(name), -(-n // 64), 64, session.main, there, room, n)
            session.read(out, room, session.main)
        return out

    check(launch, k)


@pytest.fixture(scope="module")
def short():
    return cut(1500)


def test_a_campaign_has_the_bits_of_engine_simd(device, short):
    check_engines(short, 256)


def test_an_architecture_that_nvrtc_does_not_know_is_refused(device):
    with pytest.raises(UserError, match="cannot compile for sm_35: NVRTC"):
        cuda_device.compile_cubin(SOURCE, "sm_35", OPTIONS)
