"""The registers that Taichi's compiler uses on a processor."""

import pytest

from taichi_ldem.solver.processor import NARROW, WIDE, _vector_bytes


@pytest.mark.parametrize(
    ("vendor", "family", "model", "flags", "expected"),
    [
        ("AuthenticAMD", 25, 17, "sse2 avx avx2", WIDE),  # Zen 4
        ("AuthenticAMD", 26, 2, "sse2 avx avx2", NARROW),  # Zen 5: later than LLVM 15
        ("GenuineIntel", 6, 0x8F, "avx2 avx512f", WIDE),  # Sapphire Rapids
        ("GenuineIntel", 6, 0xAD, "avx2 avx512f", WIDE),  # Granite Rapids: taken for Ice Lake
        ("GenuineIntel", 19, 1, "avx2 avx512f", NARROW),  # Diamond Rapids: no family of LLVM 15's
        ("GenuineIntel", 6, 0x3F, "sse2 avx", NARROW),  # a hypervisor hides AVX2
    ],
)
def test_columns_are_as_wide_as_the_compiler_s_registers(
    vendor: str, family: int, model: int, flags: str, expected: int
) -> None:
    described = {"vendor_id": vendor, "cpu family": str(family), "model": str(model)}
    assert _vector_bytes(described | {"flags": flags}) == expected
    assert _vector_bytes({}) == NARROW
