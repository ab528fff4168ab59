"""The width of the registers that Taichi's compiler uses on this machine's processor."""

from taichi_ldem import machine

NARROW, WIDE = 16, 32
"""Bytes of a register of every x86-64 and ARM processor, and of an AVX register."""

_KNOWN_AMD = frozenset((23, 25))
"""Families with AVX2 that LLVM 15 knows: Zen 1 to Zen 4 (it takes the last for Zen 3)."""


def vector_bytes() -> int:
    """Bytes of the widest registers that Taichi's compiler (LLVM 15) uses here.

    LLVM recognises a processor by its family and model (its Host.cpp). It takes an Intel processor
    of family 6 that it does not know for the nearest older one with the same instruction sets. For
    an unknown one of any other maker it compiles for the common x86-64, with 16 bytes a register,
    whatever the processor can do; wider columns would then spill to memory.
    """
    return _vector_bytes(machine.processor())


def _vector_bytes(properties: dict[str, str]) -> int:
    if "avx2" not in properties.get("flags", "").split():
        return NARROW
    family = int(properties.get("cpu family", "0"))
    intel = properties.get("vendor_id") == "GenuineIntel" and family == 6
    amd = properties.get("vendor_id") == "AuthenticAMD" and family in _KNOWN_AMD
    return WIDE if intel or amd else NARROW
