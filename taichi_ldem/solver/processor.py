"""The width of the registers that Taichi's compiler uses on this machine's processor."""

from taichi_ldem import machine

NARROW, WIDE = 16, 32
"""Bytes of a register of every x86-64 and ARM processor, and of an AVX register."""

_KNOWN_INTEL = frozenset(
    [
        *(0x3C, 0x3F, 0x45, 0x46),  # Haswell
        *(0x3D, 0x47, 0x4F, 0x56),  # Broadwell
        *(0x4E, 0x55, 0x5E, 0x66, 0x8E, 0x9E, 0xA5, 0xA6),  # Skylake to Cannon Lake
        *(0x6A, 0x6C, 0x7D, 0x7E, 0x8C, 0x8D, 0xA7),  # Ice Lake, Tiger Lake, Rocket Lake
        *(0x8F, 0x97, 0x9A),  # Sapphire Rapids, Alder Lake
    ]
)
"""Models of family 6 with AVX2 that LLVM 15 knows (its Host.cpp)."""

_KNOWN_AMD = frozenset((23, 25))
"""Families with AVX2 that LLVM 15 knows: Zen 1 to Zen 4 (the last taken for Zen 3)."""


def vector_bytes() -> int:
    """Bytes of the widest registers that Taichi's compiler (LLVM 15) uses here.

    For a processor that it does not know by family and model it makes code for any x86-64, with
    16 bytes a register, whatever the processor can do. Wider columns would then spill.
    """
    return _vector_bytes(machine.processor())


def _vector_bytes(properties: dict[str, str]) -> int:
    if "avx2" not in properties.get("flags", "").split():
        return NARROW
    family, model = (int(properties.get(key, "0")) for key in ("cpu family", "model"))
    intel = properties.get("vendor_id") == "GenuineIntel" and family == 6 and model in _KNOWN_INTEL
    amd = properties.get("vendor_id") == "AuthenticAMD" and family in _KNOWN_AMD
    return WIDE if intel or amd else NARROW
